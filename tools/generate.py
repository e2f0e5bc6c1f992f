"""All generated files: `./run generate` writes what is stale, `./run generate --check` names it."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import api_reference
import commands_reference
import config_reference
import config_schema
import mail_pictures
import metrics_reference
import mixin
import prometheus_operator
import runbook_pages
import versions
from bench import scaling
from experiments import silent_report

CHECKOUT = Path(__file__).resolve().parents[1]
SDK = "grafana_foundation_sdk"
Files = Mapping[Path, str | None]  # what each file is to hold; None: it is to be deleted


def dashboards() -> Files:
    """The dashboards and the page that lists them; raises ModuleNotFoundError without its SDK."""
    from fleet_dashboards import files  # noqa: PLC0415 - needs Python 3.11

    return files.files()


GENERATORS: dict[str, Callable[[], Files]] = {
    "schemas of fleet.yml": config_schema.files,
    "reference of fleet.yml": config_reference.files,
    "reference of metrics": metrics_reference.files,
    "reference of commands": commands_reference.files,
    "paths of the port": api_reference.files,
    "rules for Kubernetes": prometheus_operator.files,
    "pages of runbooks": runbook_pages.files,
    "dashboards": dashboards,
    "mixin": mixin.files,
    "tables of docs/scaling.md": scaling.files,
    "reference of silent faults": silent_report.files,
    "versions": versions.files,
}


def stale(files: Files) -> list[Path]:
    """Those that do not hold what they are to hold."""
    return [path for path, text in files.items() if _content(path) != text]


def _content(path: Path) -> str | None:
    return path.read_text(encoding="utf-8") if path.exists() else None


def write(files: Files) -> None:
    """Make each hold what it is to hold."""
    for path, text in files.items():
        if text is None:
            path.unlink(missing_ok=True)
        else:
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Write or name what is stale; the exit code."""
    parser = argparse.ArgumentParser("./run generate", description=__doc__)
    parser.add_argument(
        "--check", action="store_true", help="write nothing, fail if a file is stale"
    )
    options = parser.parse_args(arguments)
    files = _all()
    wrong = [*stale(files), *mail_pictures.stale()]
    if options.check:
        for path in wrong:
            sys.stderr.write(f"{_name(path)} is stale; './run generate' writes it\n")
        return 1 if wrong else 0
    write({path: files[path] for path in wrong if path in files})
    mail_pictures.make(path for path in wrong if path not in files)
    for path in wrong:
        sys.stdout.write(f"{_name(path)} {'written' if path.exists() else 'deleted'}\n")
    return 0


def _all() -> Files:
    files: dict[Path, str | None] = {}
    for name, generator in GENERATORS.items():
        files |= _generated(name, generator)
    return files


def _generated(name: str, generator: Callable[[], Files]) -> Files:
    try:
        return generator()
    except ModuleNotFoundError as error:
        if error.name != SDK:
            raise
        sys.stderr.write(f"{name}: not looked at: Grafana's SDK needs Python 3.11 or newer\n")
        return {}


def _name(path: Path) -> Path:
    return path.relative_to(CHECKOUT) if path.is_relative_to(CHECKOUT) else path


if __name__ == "__main__":
    sys.exit(main())
