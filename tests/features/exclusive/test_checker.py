"""I5: of an exclusive task one coalition at a time, and never again once it is in doubt."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from mrbt_mesh.core.agent.effects import StartAction
from mrbt_mesh.core.agent.inputs import ActionFinished, ActionStopped, Input
from mrbt_mesh.core.facts.records import CLAIM, Claim, Phase
from mrbt_mesh.core.facts.store import Entry, Version, parse_entry
from mrbt_mesh.features.exclusive.fields import InDoubtPolicy
from mrbt_mesh.features.exclusive.kinds import GRANT
from mrbt_mesh.sim import simulate
from mrbt_mesh.sim.checkers.checkers import Checkers
from tests.support import inside
from tests.support.build import jointly
from tests.support.checked_team import SECOND_US, Team
from tests.support.runs import Run, example


class Dosing:
    """Robots at an exclusive task, as the checker of I5 sees them."""

    def __init__(self, run: Run, in_doubt: InDoubtPolicy = InDoubtPolicy.HOLD) -> None:
        mission, program = example("dispense")
        tasks = dict(mission.global_tasks)
        tasks["dose(a)"] = dataclasses.replace(
            tasks["dose(a)"], joint=jointly(exclusive=True, in_doubt=in_doubt)
        )
        result = simulate(mission, program, seed=1, timeout_us=SECOND_US)
        self.team = Team(agent for _, agent in sorted(result.agents.items()))
        self.team.mission = dataclasses.replace(mission, global_tasks=tasks)
        self.team.checkers = Checkers(self.team)  # type: ignore[arg-type]
        self.processes: dict[str, Any] = {p.robot: p for p in self.team.processes}

    def sync(self, process: Any, entry: Entry) -> None:
        self.team.checkers.of_features.synced(process, {(entry.author, entry.name): entry})

    def begin(self, robot: str, token: str, givers: int = 4, is_claimed: bool = True) -> list[str]:
        process = self.processes[robot]
        for giver in list(self.processes.values())[:givers]:
            version = Version(giver.agent.view.incarnation, 1)
            grant = parse_entry(giver.robot, f"{GRANT}/a:1/{token}", version, True)
            self.sync(giver, grant)
        if is_claimed:
            claim = Claim("a:1", "dose(a)", "dose(a)", Phase.READY, 1)
            version = Version(process.agent.view.incarnation, 1)
            self.sync(process, parse_entry(robot, CLAIM, version, claim.to_value()))
        start = StartAction(
            7, "a:1", "dose(a)", "dose(a)", (), 1, process.agent.view.incarnation, token
        )
        self.team.checkers.of_features.handled(process, [start])
        inside.pretend_to_work(process.agent, "a:1", "dose(a)", "dose(a)", coalition=token)
        return [text.partition("which ")[2] or text for text in self.team.checkers.violations]

    def end(self, robot: str, event: Input) -> None:
        process = self.processes[robot]
        self.team.checkers.of_features.handling(process, process.agent.view, event)


def test_i5_two_coalitions_at_once(run: Run) -> None:
    dosing = Dosing(run)
    assert dosing.begin("D1", "t1") == []
    (text,) = dosing.begin("D2", "t2")
    assert "D2 begins a:1 (t2) while D1 are at it (t1)" in text


def test_i5_two_coalitions_one_after_the_other_only_if_the_first_has_failed(run: Run) -> None:
    dosing = Dosing(run)
    dosing.begin("D1", "t1")
    dosing.end("D1", ActionFinished(7, success=False))
    assert dosing.begin("D2", "t2") == []
    dosing.end("D2", ActionFinished(7, success=True))
    assert dosing.begin("D1", "t3") == ["was finished (t2)"]
    assert dosing.team.checkers.of_features.done_twice == 0
    dosing.end("D1", ActionFinished(7, success=True))
    assert dosing.team.checkers.of_features.done_twice == 1


@pytest.mark.parametrize(
    ("policy", "found"),
    [(InDoubtPolicy.HOLD, ["was left in doubt (t1)"]), (InDoubtPolicy.RETRY, [])],
)
def test_i5_a_task_in_doubt(run: Run, policy: InDoubtPolicy, found: list[str]) -> None:
    dosing = Dosing(run, policy)
    dosing.begin("D1", "t1")
    dosing.end("D1", ActionStopped(7))
    assert dosing.begin("D2", "t2") == found


def test_i5_a_majority_has_to_grant_it(run: Run) -> None:
    half = len(Dosing(run).team.mission.robots) // 2
    assert Dosing(run).begin("D1", "t1", givers=half + 1) == []
    (text,) = Dosing(run).begin("D1", "t1", givers=half)
    assert text.startswith("only ")
    assert text.count(",") == half - 1


def test_i5_the_claim_is_on_disk(run: Run) -> None:
    (text,) = Dosing(run).begin("D1", "t1", is_claimed=False)
    assert "D1 begins a:1, and its claim is not on disk" in text


def test_i5_whoever_is_gone_or_frozen_does_nothing(run: Run) -> None:
    dosing = Dosing(run, InDoubtPolicy.RETRY)
    dosing.begin("D1", "t1")
    dosing.processes["D1"].runs = False
    assert dosing.begin("D2", "t2") == []
