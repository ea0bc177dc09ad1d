"""mrbt recording what-if: a recorded run, and how it would have gone on."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.support.command import EXPLORE, mrbt, refused


def recording(*arguments: str) -> tuple[int, str, str]:
    return mrbt("recording", *arguments)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> str:
    made: Path = tmp_path_factory.mktemp("what_if") / "run"
    assert mrbt("sim", "run", EXPLORE, "--seed", "3", "--record", str(made))[0] == 0
    return str(made / "run.mcap")


def test_a_death_that_did_not_happen(file: str) -> None:
    code, output, _ = recording("what-if", file, "--at", "2", "--kill", "R1", "--json")
    told = json.loads(output)
    assert code == 0
    assert told["faults"] == ["--kill R1@2.000000"]
    assert told["under_way"].keys() == {"R1", "R2"}
    assert told["recorded"]["result"] == told["what_if"]["result"] == "success"
    assert told["what_if"]["over_at_s"] > told["recorded"]["over_at_s"] + 3
    assert any("takes as long" in text for text in told["assumed"])


def test_both_stand_side_by_side(file: str) -> None:
    code, output, _ = recording(
        "what-if", file, "--at", "2", "--kill", "R1@3,R2@3", "--timeout", "20"
    )
    assert code == 3
    assert "what happened" in output
    assert "from 2 s on: --kill R1@3, --kill R2@3" in output
    assert "assumed: " in output


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (("--at", "999"), "--at 999: the recording ends at"),
        (("--at", "2", "--kill", "R1@1"), "before --at 2, when it goes on"),
        (("--at", "2", "--kill", "R9"), "no robot 'R9'"),
        (("--at", "2", "--fault", "R1"), "which local task?"),
    ],
)
def test_what_does_not_fit_together(file: str, words: tuple[str, ...], problem: str) -> None:
    assert problem in refused(recording("what-if", file, *words))
