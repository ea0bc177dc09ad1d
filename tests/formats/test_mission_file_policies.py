"""Mission files: when a global task fails, and whether a mission ends."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mrbt_mesh.core.mission.mission import FailurePolicy, Mission, MissionEnd, mission_from_json
from mrbt_mesh.errors import FileError
from mrbt_mesh.formats.build import mission_from_yaml

FILE = """
mission: m
local_tasks: {weld: {}}
robot_types: {A: {capabilities: {weld: 1}}}
robots: {A1: A}
global_tasks:
  fix: {needs: {weld: {}}}
tree: fix
"""


def load(text: str) -> Mission:
    return mission_from_yaml(text, "m.yaml", Path())


@pytest.mark.parametrize(
    ("failure", "policy", "after_us"),
    [
        ("paper", FailurePolicy.PAPER, None),
        ("{after_s: 2.5}", FailurePolicy.RESILIENT, 2_500_000),
        ("{policy: paper, after_s: 1}", FailurePolicy.PAPER, 1_000_000),
    ],
)
def test_when_a_global_task_fails(
    failure: str, policy: FailurePolicy, after_us: int | None
) -> None:
    mission = load(FILE.replace("{weld: {}}}\ntree", f"{{weld: {{}}}}, failure: {failure}}}\ntree"))
    (task,) = mission.global_tasks.values()
    assert (task.failure, task.failure_after_us) == (policy, after_us)
    assert mission_from_json(json.loads(json.dumps(mission.to_json()))) == mission


def test_whether_a_mission_ends() -> None:
    once, never = load(FILE), load(FILE.replace("mission: m", "mission: m\nends: never"))
    assert (once.ends, never.ends) == (MissionEnd.ONCE, MissionEnd.NEVER)
    assert load(FILE.replace("mission: m", "mission: m\nends: once")).digest == once.digest
    assert never.digest != once.digest, "robots must agree on it"
    assert mission_from_json(json.loads(json.dumps(never.to_json()))) == never
    with pytest.raises(FileError, match="once or never is expected, found the text 'later'"):
        load(FILE.replace("mission: m", "mission: m\nends: later"))


@pytest.mark.parametrize(
    ("failure", "message"),
    [
        ("patient", "resilient, paper or first is expected, found the text 'patient'"),
        ("3", "resilient, paper, first, or {after_s: 5} is expected, found the number 3"),
        ("{}", "the key 'after_s' is missing"),
        ("{after_s: 0}", "a number above 0 is expected"),
        ("{policy: often, after_s: 3}", "resilient or paper is expected"),
    ],
)
def test_what_is_no_policy_is_refused(failure: str, message: str) -> None:
    with pytest.raises(FileError) as caught:
        load(FILE.replace("{weld: {}}}\ntree", f"{{weld: {{}}}}, failure: {failure}}}\ntree"))
    assert message in str(caught.value)
    assert str(caught.value).startswith("m.yaml:7")


def test_what_local_tasks_set_is_ground_in_the_global_task() -> None:
    text = FILE.replace(
        "{weld: {}}\nrobot",
        "{weld: {parameters: [p], effects: {hot($p): true}}}\n"
        "conditions: {hot: {parameters: [p]}}\nrobot",
    )
    text = text.replace("{needs: {weld: {}}}", "{needs: {weld(3): {}}}")
    mission = load(text)
    (task,) = mission.global_tasks.values()
    assert task.effects == (("hot(3)", True),)
    assert mission_from_json(json.loads(json.dumps(mission.to_json()))) == mission
    assert load(FILE).global_tasks["fix"].effects == ()
    for wrong, message in (("cold($p)", "'cold' is not a declared condition"), ("hot($q)", "$q")):
        with pytest.raises(FileError) as caught:
            load(text.replace("hot($p)", wrong))
        assert message in str(caught.value)


def test_what_the_file_says_of_blocked_tasks_is_for_those_that_do_not_say_it() -> None:
    text = "blocked: {fail_after_s: 2}" + FILE
    (task,) = load(text).global_tasks.values()
    assert task.blocked_fail_after_us == 2_000_000
    waits = text.replace("{weld: {}}}\ntree", "{weld: {}}, blocked: wait}\ntree")
    (task,) = load(waits).global_tasks.values()
    assert task.blocked_fail_after_us is None
    with pytest.raises(FileError, match="a number above 0 is expected"):
        load(text.replace("2}", "0}"))
