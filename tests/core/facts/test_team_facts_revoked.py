"""What is left of the facts of a robot whose key was revoked."""

from __future__ import annotations

from mrbt_mesh.core.facts.records import Outcome
from mrbt_mesh.core.facts.store import Incarnation, Version, make_entry
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.keys import Role
from mrbt_mesh.core.membership.replica import Replica
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import Header
from mrbt_mesh.features.revisions.facts import Revisions
from mrbt_mesh.features.revisions.records import HeldMission
from tests.support import build
from tests.support.build import RUN, World, action, sequence
from tests.support.keys import keys_of, manifest_of

TREE = sequence(action("a"), action("b"))
ROBOTS = {robot: {"a": 1, "b": 1} for robot in ("R1", "R2", "R3")}


def test_its_facts_say_nothing_and_stay_where_they_are() -> None:
    team = World(build.make_mission(TREE, ROBOTS))
    activation = team.activation("a")
    team.outcome(activation, True, "R3", "a")
    assert team.facts.has_outcome(activation)
    digest = team.facts.map.digest()
    team.facts.set_revoked(frozenset({"R3"}))
    assert not team.facts.has_outcome(activation)
    assert "R3" not in team.facts.members
    assert "R1" in team.facts.members
    assert team.facts.map.digest() == digest
    team.facts.set_revoked(frozenset())
    assert team.facts.has_outcome(activation)


def test_what_comes_later_of_it_says_nothing_either() -> None:
    team = World(build.make_mission(TREE, ROBOTS))
    activation = team.activation("a")
    team.facts.set_revoked(frozenset({"R3"}))
    team.outcome(activation, True, "R3", "a")
    assert not team.facts.has_outcome(activation)
    team.outcome(activation, True, "R2", "a")
    assert team.facts.has_outcome(activation)


def test_it_has_no_say_in_revisions() -> None:
    facts = TeamFacts(build.make_mission(TREE, ROBOTS), RUN)
    version = Version(Incarnation(1, "n"), 1)
    facts.map.merge([make_entry("R3", "mission_held", version, HeldMission(1, "d", "no", 0))])
    assert facts.index(Revisions).void_reason(1)
    facts.set_revoked(frozenset({"R3"}))
    assert not facts.index(Revisions).void_reason(1)


def test_a_replica_goes_by_the_manifest_once_the_robot_is_not_alive() -> None:
    keys = keys_of("R1", "R2", "R3")["R1"]
    mission = build.make_mission(TREE, ROBOTS)
    header = Header(mission.team_digest[:16], mission.name, RUN, "R1")
    mine = Replica(TeamFacts(mission, RUN, "R1"), header, Timing(), "n", keys=keys)
    name = f"outcome/{RUN}:1:a::0/a"
    version = Version(Incarnation(1, "n"), 1)
    mine.facts.map.merge([make_entry("R3", name, version, Outcome(True))])
    roles = {"R1": Role.ROBOT, "R2": Role.ROBOT, "op": Role.OPERATOR}
    mine.follow_keys({"R1", "R3"})
    assert mine.facts.has_outcome(f"{RUN}:1:a::0")
    keys.replace(manifest_of(roles, version=2))
    mine.follow_keys({"R1", "R3"})
    assert mine.facts.has_outcome(f"{RUN}:1:a::0")
    mine.follow_keys({"R1"})
    assert not mine.facts.has_outcome(f"{RUN}:1:a::0")
