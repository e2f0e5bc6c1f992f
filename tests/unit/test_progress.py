"""The line that says what a run of the tests is doing."""

from support.progress import INTERVAL, MOST, Progress


def test_a_line_names_the_tests_that_have_been_running_longest():
    progress = Progress(begin=100.0)
    for number in range(MOST + 2):
        progress.start(f"test_{number}", 100.0 + number)
    progress.finish("test_0")
    assert progress.due_line(20, 100.0 + INTERVAL - 1) is None
    line = progress.due_line(20, 175.0)
    assert line == (
        "1:15, 1 of 20 done, running: test_1 (74 s), test_2 (73 s), test_3 (72 s), test_4 (71 s)"
    )


def test_the_next_line_is_due_half_a_minute_after_the_last():
    progress = Progress(begin=0.0)
    assert progress.due_line(1, INTERVAL)
    assert progress.due_line(1, INTERVAL + 1) is None
    assert progress.due_line(1, 2 * INTERVAL)
