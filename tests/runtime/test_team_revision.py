"""The way of a revision as its client sees it: what is refused is not in force."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import anyio
import pytest

from mrbt_mesh.core.facts.store import Incarnation, Version, make_entry
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.compiled import compile_mission
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.features.revisions.records import AdoptedMission, HeldMission
from mrbt_mesh.features.revisions.revise import revise
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.runtime import team_revision
from mrbt_mesh.runtime.operator_call import CommandRefusedError
from mrbt_mesh.runtime.team_revision import Consent, RevisionRefusedError, take_up
from tests.support.commands import command

FILE = """
mission: two
ends: never
local_tasks: {w: {work: 1}}
robot_types: {r: {capabilities: {w: 1}}}
robots: {R1: r%s}
global_tasks: {t: {needs: {w: {}}}}
tree: t
"""
TWO = mission_from_yaml(FILE % ", R2: r", "two.yaml", Path())
ONE = revise(TWO, mission_from_yaml(FILE % "", "one.yaml", Path()))
OTHER = revise(TWO, mission_from_yaml(FILE % ", R3: r", "other.yaml", Path()))
SHORTAGE = "it is in the journals of 1 robots (R1), and 2 were asked for; R2 has not answered"


class Team:
    """R1, and R2 which leaves as soon as a revision that removes it is in force, and answers
    nothing. `comes`: the revision that comes into force, None: none does.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch, comes: Mission | None) -> None:
        self.facts = TeamFacts(TWO, "run")
        self.alive = {"R1": Incarnation(1, "a"), "R2": Incarnation(1, "b")}
        self.comes = comes
        self.withdrawn: list[int] = []
        membership = SimpleNamespace(members=lambda: self.alive)
        observer = SimpleNamespace(facts=self.facts, membership=membership)
        self.watcher: Any = SimpleNamespace(
            observer=observer,
            wait_for_change=lambda _: anyio.sleep(0.001),
            timing=SimpleNamespace(heartbeat_us=100_000),
        )
        self.robots = ["R1", "R2"]
        monkeypatch.setattr(team_revision, "TeamClient", lambda _: self)
        monkeypatch.setattr(team_revision, "WITHDRAW_S", 0.05)
        self.is_late = False

    async def propose(self, number: int, text: str, *_: bool) -> None:
        """The call is not acknowledged: R2 has not answered."""
        if self.comes is not None:
            found, version = self.comes, Version(Incarnation(9, "n"), 1)
            text = compile_mission(found)
            self.facts.map.merge([command(f"mission/{number}", [text, False, False])])
            await anyio.sleep(0)
            adopted = AdoptedMission(found.digest)
            self.facts.map.merge([make_entry("R1", f"mission_adopted/{number}", version, adopted)])
            self.hold(number, found.digest)
            self.alive.pop("R2")
        if self.is_late:
            raise TimeoutError(SHORTAGE)
        await anyio.sleep_forever()

    def hold(self, number: int, digest: str) -> None:
        version = Version(Incarnation(9, "n"), 2)
        held = HeldMission(number, digest, "", number)
        self.facts.map.merge([make_entry("R1", "mission_held", version, held)])

    async def withdraw(self, number: int) -> None:
        if self.comes is not None:
            raise CommandRefusedError("it is in force", "ended")
        self.withdrawn.append(number)


def taken_up(team: Team, timeout_s: float = 5) -> None:
    async def main() -> None:
        team.watcher.observer.facts = team.facts
        await take_up(team.watcher, ONE, Consent(True), timeout_s, lambda _: None)

    anyio.run(main)


@pytest.mark.parametrize("is_late", [False, True])
def test_a_robot_that_leaves_by_a_revision_need_not_answer(
    monkeypatch: pytest.MonkeyPatch, is_late: bool
) -> None:
    team = Team(monkeypatch, ONE)
    team.is_late = is_late
    taken_up(team)
    assert team.facts.in_force == ONE


def test_what_is_not_acknowledged_is_withdrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    team = Team(monkeypatch, None)
    team.is_late = True
    with pytest.raises(RevisionRefusedError, match="R2 has not answered: revision 1 is withdrawn"):
        taken_up(team)
    assert team.withdrawn == [1]


def test_another_revision_of_the_same_number_is_not_this_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for is_late in (False, True):
        team = Team(monkeypatch, OTHER)
        team.is_late = is_late
        with pytest.raises(RevisionRefusedError):
            taken_up(team, 0.2)
        assert team.withdrawn == []
