"""What a robot answers to a proposed revision."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from unittest import mock

import pytest

from mrbt_mesh.core.agent.commands_on_disk import AwaitedAnswer
from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.operator_messages import (
    CONFLICT,
    NOT_READY,
    CommandStep,
    command_version,
    operate_body,
)
from mrbt_mesh.core.facts.store import Incarnation, Version, make_entry
from mrbt_mesh.core.feature import Kit
from mrbt_mesh.core.membership.keys import make_command
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.features.revisions.messages import CHECK_REVISION, CheckMission
from mrbt_mesh.features.revisions.records import HeldMission
from mrbt_mesh.features.revisions.revise import revise
from mrbt_mesh.features.revisions.reviser import Reviser
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.formats.mission_file import compile_mission
from tests.support.one_robot import MISSION, desk
from tests.support.paths import mission_file

FILE = mission_file("deliveries")
# Without D1, whose desk it is.
OTHERS = replace(
    mission_from_yaml(
        re.sub(r"D1: \w+, ", "", FILE.read_text(encoding="utf-8")), "m.yaml", FILE.parent
    ),
    solver="cp_sat",
)


def _check(context: Context, mission: Mission) -> tuple[bool, str]:
    kit = Kit(context, mock.Mock(), mock.Mock(), mock.Mock(), mock.Mock())
    return Reviser(kit).words()[CHECK_REVISION](compile_mission(mission), 0)


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


@pytest.mark.parametrize("is_named", [True, False])
def test_a_robot_that_cannot_plan_a_revision_refuses_it_though_its_program_fits(
    is_named: bool,
) -> None:
    """Also one that has joined without being named, since it plans as all do."""
    _, context = desk()
    context.config = replace(context.config, lacks_planner=True)
    if not is_named:
        context.mission = OTHERS
    mission = MISSION if is_named else OTHERS
    good, answer = _check(context, mission)
    assert good
    assert "pip install 'mrbt-mesh[planner]'" in json.loads(answer)["problem"]
    assert not context.take_effects()


def test_a_robot_that_leaves_by_a_revision_need_not_plan_it() -> None:
    _, context = desk()
    context.config = replace(context.config, lacks_planner=True)
    assert _check(context, OTHERS) == (True, json.dumps({"problem": ""}))


def test_with_the_libraries_its_program_is_asked() -> None:
    _, context = desk()
    _check(context, MISSION)
    assert [type(effect) for effect in context.take_effects()] == [CheckMission]
