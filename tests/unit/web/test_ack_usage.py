from __future__ import annotations

import pytest

from ros_diagnostics_exporter.ack import main


@pytest.mark.parametrize("days", ["-1", "0", "nan", "1e9", "long"])
def test_a_number_of_days_that_no_silence_can_last_is_refused(days, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["robot_1", "--comment", "on it", "--days", days])
    assert ended.value.code == 2
    assert f"'{days}' is not a number of days, at most 3650" in capsys.readouterr().err
