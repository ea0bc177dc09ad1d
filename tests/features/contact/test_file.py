"""`on_lost_contact` of robot types: what it becomes, and what is refused with a remedy."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.mission.compiled import compile_mission, mission_from_compiled
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.errors import FileError
from mrbt_mesh.features.contact.policy import (
    MAX_MAJORITY,
    ContactOf,
    LostContact,
    OnLostContact,
    policies,
)
from mrbt_mesh.formats.build import mission_from_yaml


def mission(on_lost_contact: str, robots: int = 3) -> Mission:
    named = ", ".join(f"A{number}: cart" for number in range(robots))
    return mission_from_yaml(
        f"""
mission: m
local_tasks: {{work: {{}}, park: {{}}}}
robot_types:
  cart:
    capabilities: {{work: 1, park: 1}}
    on_lost_contact: {on_lost_contact}
robots: {{{named}}}
global_tasks: {{do: {{needs: {{work: {{}}}}}}}}
tree: do
""",
        "m.yaml",
        Path(),
    )


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{after_s: 2.5, then: hold}", (2_500_000, ContactOf.TEAM, OnLostContact.HOLD, "")),
        (
            "{after_s: 5, of: operator, then: return, return: park}",
            (5_000_000, ContactOf.OPERATOR, OnLostContact.RETURN, "park"),
        ),
    ],
)
def test_it_is_part_of_the_mission(
    text: str, expected: tuple[int, ContactOf, OnLostContact, str]
) -> None:
    found = mission(text)
    assert policies(found) == {"cart": LostContact(*expected)}
    again = mission_from_compiled(compile_mission(found), "m.json")
    assert (policies(again), again.digest) == (policies(found), found.digest)


def test_a_majority_is_of_robots_that_all_hear_one_another() -> None:
    assert Timing().all_are_neighbours(MAX_MAJORITY)
    assert not Timing().all_are_neighbours(MAX_MAJORITY + 1)


def test_to_go_on_is_as_if_nothing_were_said() -> None:
    assert mission("{after_s: 5, then: go_on}").digest == mission("null").digest


@pytest.mark.parametrize(
    ("text", "robots", "message"),
    [
        ("{after_s: 0.2, then: hold}", 3, "after_s"),
        ("{after_s: 5, then: stop}", 3, "then"),
        ("{after_s: 5, then: return}", 3, "`return: LOCAL_TASK` names what `then: return`"),
        ("{after_s: 5, then: hold, return: park}", 3, "give both or neither"),
        ("{after_s: 5, then: return, return: fly}", 3, "cart cannot do 'fly'; it has park, work"),
        ("{after_s: 5, then: hold}", 1, "no other robot to hear; use `of: operator`"),
        ("{after_s: 5, of: majority, then: hold}", 60, "of 60 robots each hears a few only"),
    ],
)
def test_what_cannot_be_is_refused(text: str, robots: int, message: str) -> None:
    with pytest.raises(FileError) as error:
        mission(text, robots)
    assert message in str(error.value)
    assert "m.yaml:" in str(error.value)
