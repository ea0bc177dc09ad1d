"""Files of cases that cannot be used: what is wrong, and no traceback."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks import allocation
from benchmarks.schedule_traffic import drawn_case

CASE = {**drawn_case(5), "ctas_d": {"time": 9.0}}


@pytest.mark.parametrize(
    ("content", "options", "problem"),
    [
        (None, [], "No such file or directory"),
        ("{", [], "Expecting property name"),
        ('{"a": 1}', [], "not a file of RALTestSet cases as JSON (TypeError: "),
        ("[]", [], "it has no cases"),
        ([{**CASE, "ctas_d": {}}], [], "cases as JSON (KeyError: 'time')"),
        ([CASE], ["--noise", "1"], "--noise is from 0 to below 1"),
    ],
)
def test_what_cannot_be_used_exits_2(
    content: Any,
    options: list[str],
    problem: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = tmp_path / "cases.json"
    if content is not None:
        path.write_text(content if isinstance(content, str) else json.dumps(content))
    monkeypatch.setattr("sys.argv", ["allocation", str(path), *options])
    with pytest.raises(SystemExit) as stopped:
        allocation.main()
    assert stopped.value.code == 2
    assert problem in capsys.readouterr().err


def test_a_team_carries_out_a_case() -> None:
    row = allocation.run(CASE, plain=False, noise=0.0, deaths=0, events=None)
    assert row["result"] == "success"
    assert row["ratio"] == pytest.approx(row["time_s"] / 9.0, abs=1e-3)
