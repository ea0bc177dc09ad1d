"""Side constraints in mission files."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.core.mission.compiled import mission_from_compiled
from mrbt_mesh.core.mission.mission import Mission, Need, SameRobotAs
from mrbt_mesh.features.constraints.kinds import AtMost, NeverTogether, NotAtOnce, constraints_of
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.formats.mission_file import FileError, compile_mission
from tests.support.paths import ROOT

DOCUMENT = ROOT / "docs" / "how-to" / "constraints.md"
CARRY = """
mission: carry
local_tasks: {pick: {parameters: [item]}, place: {parameters: [item]}}
robot_types: {Arm: {capabilities: {pick: 1, place: 1}}}
robots: {R1: Arm, R2: Arm, R3: Arm}
global_tasks:
  fetch: {parameters: [item], needs: {pick($item): {}}}
  bring:
    parameters: [item]
    needs:
      place($item): {same_robot_as: {global_task: fetch($item), local_task: pick($item)}}
tree: {Sequence: [fetch(1), bring(1)]}
"""
LIMITS = """
constraints:
  never_together: [{robots: [R2, R1], local_tasks: [pick, place(1)]}, {robots: [R1, R3]}]
  at_most: [{robots: [R1, R2, R3], count: 2}, {robots: [R1, R2]}]
  not_at_once: [{global_tasks: [fetch, bring(1)]}]
"""


def load(text: str) -> Mission:
    return mission_from_yaml(text, "m.yaml", Path("/nowhere"))


def test_they_are_read_and_survive_compiling() -> None:
    mission = load(CARRY + LIMITS)
    assert constraints_of(mission) == (
        NeverTogether(("R1", "R2"), ("pick", "place(1)")),
        NeverTogether(("R1", "R3")),
        AtMost(("R1", "R2", "R3"), 2),
        AtMost(("R1", "R2"), 1),
        NotAtOnce(("bring(1)", "fetch"), 1),
    )
    assert mission_from_compiled(compile_mission(mission), "m.json") == mission


def test_teams_that_differ_in_them_are_different_teams() -> None:
    plain, limited = load(CARRY), load(CARRY + LIMITS)
    assert plain.digest != limited.digest
    assert "sections" not in json.loads(compile_mission(plain))
    assert plain.digest != load(re.sub(r"place\(.*", "place($item): {}", CARRY)).digest


def test_same_robot_as_is_ground_and_survives_compiling() -> None:
    mission = load(CARRY)
    need = Need("place(1)", 1, 1, SameRobotAs("fetch(1)", "pick(1)"))
    assert mission.global_tasks["bring(1)"].needs == (need,)
    assert mission_from_compiled(compile_mission(mission), "m.json") == mission
    assert load(CARRY.replace(", local_task: pick($item)", "")) == mission


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "robots: [R2, R1]",
            "robots: [R2, R9]",
            "never_together[1]/robots[2]: no robot 'R9'; known",
        ),
        ("robots: [R2, R1]", "robots: [R2, R2]", "'R2' is given twice; keep one"),
        ("robots: [R2, R1]", "robots: [R2]", "at least 2"),
        ("[pick, place(1)]", "[pik]", "local_tasks[1]: no local task 'pik'; did you mean 'pick'?"),
        ("[pick, place(1)]", '["pick(1,2)"]', "pick has 1 parameters, found 2"),
        ("[fetch, bring(1)]", "[fetch(2)]", "the tree has no global task 'fetch(2)'"),
        ("count: 2", "count: 0", "at_most[1]/count: "),
        ("count: 2", "count: 3", "3 of 3 robots limits nothing"),
        ("at_most:", "atmost:", "unknown key 'atmost'; did you mean 'at_most'?"),
        ("mission: carry", "mission: carry\nsolver: min_cost_flow", "min_cost_flow knows no side"),
        ("[fetch(1), bring(1)]", "[bring(1), fetch(1)]", "which does not come before it in the"),
        ("[fetch(1), bring(1)]", "[fetch(2), bring(1)]", "which does not come before it in the"),
        (
            "global_task: fetch(",
            "global_task: fech(",
            "'fech' is not a declared global task",
        ),
        (
            "global_task: fetch($item)",
            "global_task: fetch",
            "global task 'fetch' takes 1 argument",
        ),
        ("local_task: pick($item)", "local_task: pick(7)", "fetch(1) needs no pick(7)"),
        ("local_task: pick($item)", "local_task: pick($it)", "same_robot_as/local_task: "),
    ],
)
def test_what_is_wrong_is_told(old: str, new: str, message: str) -> None:
    text = CARRY + LIMITS
    assert old in text
    with pytest.raises(FileError) as caught:
        load(text.replace(old, new, 1))
    assert message in str(caught.value), str(caught.value)
    assert re.match(r"m\.yaml:\d+: ", str(caught.value))


@pytest.mark.parametrize(
    "constraint",
    [
        {"AtMots": {"robots": ["R1"], "count": 1}},
        {"AtMost": {"robots": ["R1", 2], "count": 1}},
        {"AtMost": {"robots": ["R1", "R2"], "count": 0}},
        {"AtMost": {"robots": ["R1", "R2"], "count": True}},
        {"AtMost": {"robots": ["R1", "R2"]}},
        {"NeverTogether": {"robots": ["R1", "R2"], "local_tasks": [1]}},
        {"NeverTogether": {"robots": "R1"}},
        "x",
    ],
)
def test_a_damaged_compiled_mission_is_refused(constraint: Any) -> None:
    data = json.loads(compile_mission(load(CARRY + LIMITS)))
    data["sections"]["constraints"] = [constraint]
    with pytest.raises(FileError, match="compile the mission again"):
        mission_from_compiled(json.dumps(data), "m.json")


def test_same_robot_as_in_a_damaged_compiled_mission_is_refused() -> None:
    text = compile_mission(load(CARRY))
    right = '{"global_task":"fetch(1)","local_task":"pick(1)"}'
    damaged = text.replace(right, right.replace("pick(1)", "pick(2)"))
    assert damaged != text
    with pytest.raises(FileError, match="same_robot_as"):
        mission_from_compiled(damaged, "m.json")


def test_the_documents_examples_are_right() -> None:
    text = DOCUMENT.read_text()
    blocks = re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)
    (limits,) = [block for block in blocks if block.startswith("constraints:")]
    (tasks,) = [block for block in blocks if block.startswith("global_tasks:")]
    head, _, rest = CARRY.partition("global_tasks:")
    mission = load(head + tasks + rest[rest.index("tree:") :] + limits)
    assert len(constraints_of(mission)) == 3
    assert mission.global_tasks == load(CARRY).global_tasks
