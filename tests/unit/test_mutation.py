"""lab/mutation: mutants of `except` clauses, and what `./run mutate` leaves out."""

import pytest
import yaml

from mutation import handlers
from mutation.drawn import drawn
from mutation.left_out import is_left_out
from testbed.configuration import CHECKOUT

SURVIVORS = yaml.safe_load((CHECKOUT / "lab/mutation/survivors.yml").read_text())


@pytest.mark.parametrize("survivor", SURVIVORS, ids=lambda survivor: survivor["now"])
def test_a_mutant_that_does_not_count_is_of_a_line_that_is_there(survivor):
    source = CHECKOUT / drawn(survivor["file"].partition("/")[0]).source
    assert source.is_dir()  # else no mutant that is drawn has this name
    file = source.parent / survivor["file"]
    lines = [line.strip() for line in file.read_text().splitlines()]

    assert survivor["was"] in lines
    assert survivor["now"] not in lines
    assert survivor["why"]


def test_each_class_that_is_caught_is_replaced_alone():
    text = "try: go()\nexcept (OSError, sqlite3.Error) as error: pass\nexcept a.B: pass\n"
    found = [handlers.replaced(text, each) for each in range(len(handlers.positions(text)))]
    assert found == [
        text.replace(caught, "CosmicRayTestingException")
        for caught in ("OSError", "sqlite3.Error", "a.B")
    ]
    assert handlers.positions("try: go()\nexcept: pass\n") == []


@pytest.mark.parametrize(
    ("operator", "line", "at", "expected"),
    [
        ("NumberReplacer", "    return round(component.since, 3)", "3", True),
        ("NumberReplacer", "    return round(known.read(now), 3)", "3", True),
        ("NumberReplacer", "    return round(max(a, b) * 3)", "3", False),
        ("NumberReplacer", "    return max(round(a), 3)", "3", False),
        ("NumberReplacer", '    "Factor.", example=0.01, default=1.0', "0.01", True),
        ("NumberReplacer", '    "Factor.", example=0.01, default=1.0', "1.0", False),
        ("ReplaceTrueWithFalse", "        example=True,", "True", True),
        ("ReplaceFalseWithTrue", "        example=True, default=False", "False", False),
        ("ReplaceTrueWithFalse", 'log.debug("%s", place, exc_info=True)', "True", True),
        ("NumberReplacer", "text = json.dumps(described, indent=2)", "2", True),
        ("NumberReplacer", "@lru_cache(maxsize=4096)", "4096", True),
        ("NumberReplacer", "    deque(maxlen=4096)", "4096", False),
        ("ReplaceTrueWithFalse", "    rows = zip(names, texts, strict=True)", "True", True),
        ("ReplaceTrueWithFalse", "    expected = parse(text, strict=True)", "True", False),
        ("ReplaceTrueWithFalse", "@dataclass(frozen=True)", "True", True),
        ("RemoveDecorator", "@dataclass(frozen=True)", "@", False),
        ("ReplaceTrueWithFalse", "@dataclass(frozen=True, order=True)", "True)", False),
        ("ReplaceComparisonOperator_Gt_GtE", "if at[Mark.NAMES] > self._read:", ">", True),
        ("ReplaceComparisonOperator_Gt_Lt", "if at[Mark.NAMES] > self._read:", ">", False),
        ("ReplaceComparisonOperator_Gt_GtE", 'if each["id"] > self._read[kind]:', ">", False),
        ("ReplaceComparisonOperator_Gt_GtE", "if at > already:", ">", False),
        ("ReplaceComparisonOperator_Lt_LtE", "while many and more.random() < 0.4:", "<", True),
        ("ReplaceComparisonOperator_Lt_Gt", "while many and more.random() < 0.4:", "<", False),
        ("ReplaceFalseWithTrue", "@dataclass(slots=True, eq=False, repr=False)", "False,", True),
        ("ReplaceFalseWithTrue", "@dataclass(slots=False, eq=False)", "False,", False),
        ("RemoveDecorator", "    @overload", "@", True),
        ("RemoveDecorator", "    @override", "@", True),
        ("RemoveDecorator", "@lru_cache(maxsize=4096)", "@", True),
        ("RemoveDecorator", "    @property", "@", False),
        ("RemoveDecorator", "    @cached_property", "@", False),
    ],
)
def test_a_kind_of_mutants_that_no_test_has_to_find_is_not_made(operator, line, at, expected):
    assert is_left_out(f"core/{operator}", line, line.index(at)) is expected
