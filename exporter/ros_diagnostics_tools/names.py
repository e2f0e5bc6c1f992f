"""Names of robots and components as people write them: short, copied, or mistyped."""

from __future__ import annotations

import re
from collections.abc import Iterable

from ros_diagnostics_exporter.texts import nearest, without_node
from ros_diagnostics_tools.errors import NotDoneError

_SPECIAL = re.compile(r"[][\\.+*?(){}|^$]")  # of RE2


def meant(word: str, names: Iterable[str], *, by_part: bool = True) -> str:
    """The only name that a person can mean by ``word``; ``word`` itself where there is none.

    Blanks and case do not matter, and the node in front may be missing. With ``by_part`` any part
    of the name is enough.
    """
    known = list(dict.fromkeys(names))
    if word in known:
        return word
    wanted = _folded(word)
    for found in (
        [name for name in known if wanted == _folded(name)],
        [name for name in known if wanted == _folded(without_node(name))],
        [name for name in known if by_part and wanted in _folded(name)],
    ):
        if found:
            return found[0] if len(found) == 1 else word
    return word


def _folded(name: str) -> str:
    return " ".join(name.casefold().split())


def no_robot(name: str, names: Iterable[str]) -> NotDoneError:
    """There is no such robot; a similar name, or where to find the names, is in the text."""
    way_out = hint(name, names) or "; ros-diagnostics status lists the robots"
    return NotDoneError(f"no robot {name!r}{way_out}")


def hint(name: str, names: Iterable[str]) -> str:
    """The name that was meant, perhaps; "" if none is similar."""
    near = nearest(name, names)
    return f"; the nearest is {near!r}" if near else ""


def escaped(text: str) -> str:
    """An expression that matches just this text; `regex.escape` escapes every blank, too."""
    return _SPECIAL.sub(r"\\\g<0>", text)
