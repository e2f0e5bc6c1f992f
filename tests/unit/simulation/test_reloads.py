"""A fleet.yml that changes all the time: what is found, and that what people acknowledge holds."""

import pytest

from simulation import acknowledged, reloads
from simulation.acknowledged import Alerts, humanized
from support.state_driver import ERROR, OK, WALL, StateDriver, Status

HOT, MOTOR = Status(ERROR, "Motor", "hot"), Status(OK, "Motor")
LASTS = 200


@pytest.mark.parametrize("seed", range(4))
def test_a_seed_breaks_nothing(seed):
    reloads.play(seed)


def test_the_same_seed_is_the_same_history():
    assert reloads.random_steps(7) == reloads.random_steps(7) != reloads.random_steps(8)


def test_what_a_start_would_say_is_missing_if_the_exporter_does_not(monkeypatch):
    monkeypatch.setattr(reloads, "at_start", lambda *_: {"a fault"})
    with pytest.raises(AssertionError, match="no faults beside"):
        reloads.play(0, [])


@pytest.fixture
def driver():
    return StateDriver().stand(40, HOT)


def taken(driver, after=0.0):
    """The alerts of a fault that was acknowledged so long after it could be."""
    alerts = Alerts()
    alerts.scrape(driver)
    driver.stand(after, HOT)
    alerts.scrape(driver)
    alerts.acknowledge(0, LASTS, driver.now.wall)
    return alerts


def sent(alerts):
    (found,) = alerts.sent.values() or (set(),)
    return found


def test_a_fault_that_is_acknowledged_escalates_no_more_until_that_is_over(driver):
    alerts = taken(driver)
    alerts.scrape(driver.stand(LASTS - 2, HOT))
    assert sent(alerts) == set()
    alerts.scrape(driver.stand(4, HOT))
    assert sent(alerts) == {"1"}
    alerts.scrape(driver.stand(LASTS, HOT))
    assert sent(alerts) == {"1", "2"}


def test_a_step_that_was_sent_before_is_sent_its_end_and_the_next_one_is_not_sent(driver):
    alerts = taken(driver, after=30)
    assert sent(alerts) == {"1"}
    alerts.scrape(driver.stand(LASTS - 2, HOT))
    assert sent(alerts) == {"1"}


def test_what_was_removed_escalates(driver):
    alerts = taken(driver)
    alerts.remove(0, driver.now.wall)
    alerts.scrape(driver.stand(30, HOT))
    assert sent(alerts) == {"1"}


def test_the_next_fault_escalates(driver):
    alerts = taken(driver)
    (fault,) = alerts.firing
    driver.stand(20, MOTOR)
    alerts.end(fault)
    alerts.scrape(driver.stand(80, HOT))
    assert sent(alerts) == {"1"}


def test_a_fault_that_is_another_after_a_restart_is_found(driver, tmp_path):
    alerts = taken(driver)
    lost = StateDriver()
    lost.now = driver.now
    with pytest.raises(AssertionError, match="is since"):
        alerts.scrape(lost.stand(60, HOT))
    alerts.scrape(driver.again(tmp_path / "db").stand(60, HOT))
    assert sent(alerts) == set()


def test_without_the_database_it_is_acknowledged_as_before(driver):
    alerts = taken(driver)
    lost = StateDriver()
    lost.now = driver.now
    lost.state.adopt(alerts.faults(lost), lost.now)
    alerts.keep(lost.state.faults(), lost, is_settled=True)
    alerts.scrape(lost.stand(60, HOT))
    assert sent(alerts) == set()


def test_a_silence_that_leaves_out_no_step_or_is_of_more_than_the_escalation_is_found(
    driver, monkeypatch
):
    def silence(problem, *words):
        named = [each for each in made(problem, *words)["matchers"] if each["name"] != "alertname"]
        return made(problem, *words) | {
            "matchers": [each for each in named if each["name"] == "robot"]
        }

    made = acknowledged.acknowledging.silence
    monkeypatch.setattr(acknowledged.acknowledging, "silence", silence)
    with pytest.raises(AssertionError):
        taken(driver).scrape(driver)


@pytest.mark.parametrize(
    ("unix", "text"),
    [
        (WALL, "2023-11-14 22:13:20 +0000 UTC"),
        (WALL + 0.2504, "2023-11-14 22:13:20.25 +0000 UTC"),
    ],
)
def test_a_time_is_as_rules_write_it(unix, text):
    assert humanized(unix) == text
