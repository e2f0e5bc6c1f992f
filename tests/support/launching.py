"""Stand-ins of launch and launch_ros, which are not among the wheels of ROS."""

import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

# The keywords that the launch files use, as launch and launch_ros of Jazzy document them:
# a fake that accepts any keyword would not find one that the real class rejects.
KEYWORDS = {
    "LaunchDescription": set(),
    "LaunchConfiguration": {"default"},
    "EnvironmentVariable": {"default_value"},
    "DeclareLaunchArgument": {"default_value", "description", "choices"},
    "OpaqueFunction": {"function", "args", "kwargs"},
    "ExecuteProcess": {"cmd", "name", "output", "on_exit", "respawn", "respawn_delay"},
    "Node": {
        *("package", "executable", "name", "namespace", "parameters", "remappings", "arguments"),
        *("output", "on_exit", "respawn", "respawn_delay"),  # those of ExecuteProcess
    },
}
MODULES = {
    "launch": ("LaunchContext", "LaunchDescription"),
    "launch.actions": ("DeclareLaunchArgument", "ExecuteProcess", "OpaqueFunction"),
    "launch.substitutions": ("EnvironmentVariable", "LaunchConfiguration"),
    "launch_ros": (),
    "launch_ros.actions": ("Node",),
}


class Asked:
    """Stands for any launch action: what it was made with."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        unknown = options.keys() - KEYWORDS[type(self).__name__]
        assert not unknown, f"{type(self).__name__} takes no {unknown}"
        self.arguments, self.options = arguments, options

    def perform(self, context: dict[str, str]) -> str:
        return context[self.arguments[0]]


def run(path: Path, monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """What a launch file defines, where its modules are stand-ins."""
    for module_name, classes in MODULES.items():
        module = ModuleType(module_name)
        for name in classes:
            setattr(module, name, type(name, (Asked,), {}))
        monkeypatch.setitem(sys.modules, module_name, module)
    return SimpleNamespace(**runpy.run_path(str(path)))
