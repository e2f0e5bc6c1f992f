"""The database of these tests."""

import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

Tables = dict[str, list[tuple[Any, ...]]]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Where it is, alone in a folder."""
    return tmp_path / "state"


@pytest.fixture
def content(path: Path) -> Callable[[], Tables]:
    """A function: what is in it, also while a process writes it."""

    def read() -> Tables:
        with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as connection:
            return {
                table: sorted(connection.execute(f"SELECT * FROM {table}"))
                for table in ("robots", "faults", "events")
            }

    return read


@pytest.fixture
def edit(path: Path) -> Callable[..., None]:
    """A function (statements): changes it while no process has it."""

    def change(*statements: str) -> None:
        with closing(sqlite3.connect(path)) as connection, connection:
            for statement in statements:
                connection.execute(statement)

    return change
