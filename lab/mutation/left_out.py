"""Mutants that are not made: of their whole kind, no test can find one, or none has to."""

from __future__ import annotations

import re

# By operator: what of the line stands before the place, and from it on.
_KINDS = (
    # How many digits are served is chosen.
    ("NumberReplacer", r"\bround\(([^()]|\([^()]*\))*, $", r"\d+\)"),
    # What a key of fleet.yml is shown with is chosen.
    ("NumberReplacer", r"\bexample=[^=]*$", ""),
    ("ReplaceTrueWithFalse", r"\bexample=[^=]*$", ""),
    ("ReplaceFalseWithTrue", r"\bexample=[^=]*$", ""),
    # Whether a log line has its traceback is chosen.
    ("ReplaceTrueWithFalse", r"\bexc_info=$", ""),
    # How wide JSON is indented is chosen.
    ("NumberReplacer", r"\bindent=$", ""),
    # How much a cache keeps is chosen.
    ("NumberReplacer", r"\blru_cache\(maxsize=$", ""),
    # Without a cache the same is computed again.
    ("RemoveDecorator", "", r"@(lru_)?cache\b"),
    # What is joined is equally long where the code is right: strict is there to say so.
    ("ReplaceTrueWithFalse", r"\bzip\(.*, strict=$", ""),
    # Who assigns to a field of a frozen dataclass learns it from mypy.
    ("ReplaceTrueWithFalse", r"^@dataclass\([^()]*\bfrozen=$", ""),
    # Records are compared as objects, or not at all; one that is hashed could not be with eq=True.
    ("ReplaceFalseWithTrue", r"^@dataclass\([^()]*\b(eq|repr)=$", ""),
    # Up to the mark that was read last, everything is read: reading it again gives the same.
    ("ReplaceComparisonOperator_Gt_GtE", "", r"> (self\.|reports\.)?_?read\b(?!\[)"),
    # That a number drawn at random is just the limit does not happen.
    ("ReplaceComparisonOperator_Lt_LtE", r"\brandom\(\) $", ""),
    # These are for the type checker alone.
    ("RemoveDecorator", "", "@(overload|override)$"),
)


def is_left_out(operator: str, line: str, column: int) -> bool:
    """Whether cosmic-ray's operator has no mutant at this column of a line."""
    return any(
        operator.endswith(name) and re.search(before, line[:column]) and re.match(at, line[column:])
        for name, before, at in _KINDS
    )
