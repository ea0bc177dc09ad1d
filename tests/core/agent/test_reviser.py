"""What a robot answers to a proposed revision."""

from __future__ import annotations

import pytest

from mrbt_mesh.core.agent.commands_on_disk import AwaitedAnswer
from mrbt_mesh.core.agent.operator_messages import (
    CONFLICT,
    NOT_READY,
    CommandStep,
    command_version,
    operate_body,
)
from mrbt_mesh.core.facts.records import HeldMission
from mrbt_mesh.core.facts.store import Incarnation, Version, make_entry
from mrbt_mesh.core.membership.keys import make_command
from mrbt_mesh.core.mission.revisions import revise
from mrbt_mesh.formats.mission_file import compile_mission
from tests.support.one_robot import MISSION, desk


@pytest.mark.parametrize(("number", "cause"), [(1, NOT_READY), (3, CONFLICT), (2, None)])
def test_a_revision_of_which_only_the_number_is_known_may_be_the_one_proposed(
    number: int, cause: str | None
) -> None:
    robot, context = desk()
    held = HeldMission(1, "digest", "", 0)
    for other in ("C1", "C2"):
        version = Version(Incarnation(1, "n"), 1)
        context.facts.map.merge([make_entry(other, "mission_held", version, held)])
    text = compile_mission(revise(MISSION, MISSION, number))
    value, version = [text, False, False], command_version(1, "x")
    entry = make_command(f"mission/{number}", value, "me", version, "r", None)
    answer = robot.take(operate_body(CommandStep.CHECK, entry), 0)
    assert not isinstance(answer, AwaitedAnswer)
    assert answer.get("cause") == cause, answer
