"""Wrong usage of `./run demo`: an error before anything is started."""

import pytest

from demo.__main__ import main


@pytest.mark.parametrize("seconds", ["-3", "0", "nan", "soon"])
def test_an_invalid_time_is_rejected(seconds, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--seconds", seconds])

    assert ended.value.code == 2
    assert f"argument --seconds: '{seconds}' must be a number above 0" in capsys.readouterr().err
