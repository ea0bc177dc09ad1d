"""Errors of this program are said once in full, and then counted."""

from __future__ import annotations

import pytest

from mrbt_mesh.adapters.rmf.own_errors import OwnErrors


def divide(by: int) -> float:
    return 1 / by


def look_up(name: str) -> int:
    return {"a": 1}[name]


def test_a_kind_of_errors_is_traced_once_and_counted(capsys: pytest.CaptureFixture[str]) -> None:
    own_errors = OwnErrors("rmf")
    for _ in range(10):
        for broken in (lambda: divide(0), lambda: look_up("\ud800")):
            try:
                broken()
            except Exception as error:
                own_errors.report(error)
    said = capsys.readouterr().err
    assert said.count("Traceback") == 2
    assert [line for line in said.splitlines() if line.startswith("rmf: ")] == [
        "rmf: an error of mrbt serve, number 1 of its kind: ZeroDivisionError('division by zero')",
        "rmf: an error of mrbt serve, number 1 of its kind: KeyError('\\ud800')",
        "rmf: an error of mrbt serve, number 10 of its kind: ZeroDivisionError('division by zero')",
        "rmf: an error of mrbt serve, number 10 of its kind: KeyError('\\ud800')",
    ]
