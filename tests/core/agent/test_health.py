"""What a robot tells its team of itself."""

from __future__ import annotations

from types import SimpleNamespace

from mrbt_mesh.core.agent.health import Health
from mrbt_mesh.core.agent.inputs import ProblemFound
from mrbt_mesh.core.facts.records import NETWORK
from tests.support.one_robot import desk


def test_what_is_wrong_with_a_program_ends_with_its_process() -> None:
    _, context = desk()
    context.joining = None
    before = Health(context)
    for subject in ("event loop", "robot.py: look", NETWORK):
        before.problem_found(ProblemFound(subject, f"{subject} is wrong"), 0)
    after = Health(context)
    context.joining = SimpleNamespace(is_first=True)  # type: ignore[assignment]
    after.problem_found(ProblemFound("robot.py: look", "robot.py: look is wrong"), 1)
    context.joining = None
    after.joined(2)
    found = {subject: text for subject, text in context.facts.problems["D1"].items() if text}
    # What watches the network reports its problems.
    assert found == {each: f"{each} is wrong" for each in ("robot.py: look", NETWORK)}
