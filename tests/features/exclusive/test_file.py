"""What mission files say of exclusive and simultaneous tasks."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.errors import FileError
from mrbt_mesh.features.exclusive.fields import CoalitionFields, InDoubtPolicy, policy_of
from mrbt_mesh.formats.build import mission_from_yaml

FILE = """
mission: m
local_tasks: {dose: {}}
robot_types: {arm: {capabilities: {dose: 1}}}
robots: {A1: arm, A2: arm}
global_tasks:
  dose:
    needs: {dose: {min: 1}}
    %s
tree: dose
"""


def policy(fields: str) -> CoalitionFields | None:
    mission = mission_from_yaml(FILE % fields, "m.yaml", Path())
    return policy_of(mission.global_tasks["dose"])


def test_a_task_is_done_by_each_robot_on_its_own_unless_it_says_otherwise() -> None:
    assert policy("preemptive: false") is None
    assert policy("exclusive: false") is None


def test_what_is_said_is_read() -> None:
    found = policy("exclusive: true\n    in_doubt: fail")
    assert found is not None
    assert (found.simultaneous, found.exclusive) == (False, True)
    assert found.in_doubt is InDoubtPolicy.FAIL
    found = policy("simultaneous: true\n    begin_within_s: 0.5")
    assert found is not None
    assert (found.simultaneous, found.begin_within_us) == (True, 500_000)
    assert found.in_doubt is InDoubtPolicy.HOLD


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ("in_doubt: fail", "in_doubt is for exclusive tasks; add exclusive: true or remove it"),
        (
            "begin_within_s: 2",
            "begin_within_s is for simultaneous tasks; add simultaneous: true or remove it",
        ),
    ],
)
def test_a_field_without_the_one_that_it_belongs_to_is_a_mistake(fields: str, text: str) -> None:
    with pytest.raises(FileError) as caught:
        policy(fields)
    (problem,) = caught.value.problems
    assert problem.message == text
    assert problem.line == 9
