"""Every step of every drill that comes with the project is described in a sentence."""

from __future__ import annotations

import pytest

from mrbt_mesh.drills.drill_file import drill_files, load_drills
from mrbt_mesh.drills.model import StepModel
from tests.support.paths import ROOT


@pytest.mark.parametrize(
    ("step", "text"),
    [
        ({"at": 3.5, "kill": "A1"}, "3.5 s after the start: kill A1"),
        (
            {
                "when": {"local_task": "replace_hw(2)", "phase": "running"},
                "after": 0.2,
                "stop": {"performing": "replace_hw(2)"},
            },
            "when any robot has replace_hw(2) running, after 0.2 s: "
            "freeze the robots that perform replace_hw(2)",
        ),
        (
            {"after": 1, "lose_capability": {"robots": ["A1", "A2"], "local_task": "weld"}},
            "after 1 s: have A1, A2 lose weld",
        ),
        (
            {"when": {"takeover": "weld"}, "kill": {"replacement": None}},
            "when a robot has taken weld over: kill the replacement",
        ),
        ({"after": 0, "partition": [["A", "B"], "C"]}, "after 0 s: cut the team into A, B | C"),
        ({"after": 0, "heal": True}, "after 0 s: heal the network"),
        (
            {"after": 0, "lose": {"permille": 300}},
            "after 0 s: lose 30 % of the messages from any robot to any robot",
        ),
    ],
)
def test_steps(step: dict[str, object], text: str) -> None:
    assert StepModel.model_validate(step).text() == text


def test_all_that_come_with_the_project() -> None:
    for path in drill_files(ROOT / "drills"):
        for drill in load_drills(path)[:1]:
            for step in drill.steps:
                moment, _, what = step.text().partition(": ")
                assert moment, drill.label
                assert what, drill.label
                assert "Model" not in what, drill.label
