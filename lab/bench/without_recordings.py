"""The exporter as it is, but that it keeps no recordings; the database is written as always."""

from __future__ import annotations

from unittest.mock import patch

from ros_diagnostics_exporter.cli.main import main
from ros_diagnostics_exporter.service import Service

if __name__ == "__main__":
    with patch.object(Service, "_make_recordings", return_value=None):
        main()
