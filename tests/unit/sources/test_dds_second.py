"""What the second participant of a domain says that it finds; of its middleware nothing is real."""

from unittest.mock import Mock

import pytest

from ros_diagnostics_exporter.sources import dds_second


class Middleware:
    """Topics whose messages arrive, and nodes that are there, after so many tenths of a second."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.after: dict[str, int] = {}
        self.tenths = 0.0
        self.alarm, self.context, self.node = Mock(), Mock(), Mock()
        monkeypatch.setattr(dds_second.signal, "alarm", self.alarm)
        monkeypatch.setattr(dds_second.rclpy, "init", Mock())
        monkeypatch.setattr(dds_second, "Context", lambda: self.context)
        monkeypatch.setattr(dds_second, "make_guest", lambda _name, _context: self.node)
        monkeypatch.setattr(dds_second, "Subscriber", lambda _node: self)
        monkeypatch.setattr(dds_second, "list_nodes", lambda _node: (self.nodes(), 0))
        monkeypatch.setattr(dds_second, "time", self)

    def is_there(self, name: str) -> bool:
        return self.tenths >= self.after.get(name, 1000)

    def nodes(self) -> list[tuple[str, str]]:
        there = filter(self.is_there, self.after)
        return [(each, "/" if each == "root" else "/r") for each in there]

    def subscribe(self, _kind, topic, _profile):
        return None, lambda: b"" if self.is_there(topic.removeprefix("/")) else None

    def monotonic(self) -> float:
        return self.tenths / 10

    def sleep(self, seconds: float) -> None:
        self.tenths += 10 * seconds


@pytest.fixture
def middleware(monkeypatch) -> Middleware:
    return Middleware(monkeypatch)


@pytest.mark.parametrize(
    ("wanted", "after", "found"),
    [
        (["/a", "/b"], {"a": 3, "b": 1}, (["/b", "/a"], 4)),
        (
            ["/a", "node /r/arm", "node /root"],
            {"a": 5, "arm": 2, "root": 2},
            (["node /r/arm", "node /root", "/a"], 6),
        ),
        (["node /r/arm"], {"arm": 0}, (["node /r/arm"], 1)),
        (["/a", "node /r/arm"], {"arm": 8}, (["node /r/arm"], 20)),
        (["/a"], {"a": 30}, ([], 20)),  # after its time nothing counts
    ],
)
def test_it_says_what_it_finds_and_ends_with_the_last_or_its_time(
    middleware, capsys, wanted, after, found
):
    middleware.after = after
    dds_second.main(["7", "2.0", *wanted, "--ros-args", "-r", "a:=b"])

    assert (capsys.readouterr().out.splitlines(), middleware.tenths) == found
    middleware.alarm.assert_called_once_with(dds_second.JOINED + 2)
    init = dds_second.rclpy.init.call_args.kwargs
    assert (init["domain_id"], init["args"]) == (7, ["--ros-args", "-r", "a:=b"])
    middleware.node.destroy_node.assert_called_once_with()
    middleware.context.try_shutdown.assert_called_once_with()
