"""Whole teams with schedules: proposals that are lost or false, and a team in two halves."""

from __future__ import annotations

import itertools

import pytest

from mrbt_mesh.core.agent import scheduler
from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.scheduler import Scheduler
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import Proposal
from mrbt_mesh.core.planning.schedules import Lookahead
from mrbt_mesh.core.scheduling.dispatch import Dispatcher
from mrbt_mesh.sim import NetworkKnobs, simulate
from mrbt_mesh.sim.world.faults import Block, Kill, Unblock
from mrbt_mesh.sim.world.network import LinkKnobs
from tests.support.effort import seeds
from tests.support.runs import example

SECOND_US = 1_000_000
# Of each search; what is found need not be good here.
EVALUATIONS = 100
LEFT, RIGHT = ("C1", "C2", "L1"), ("C3", "L2", "S1")


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scheduler, "evaluations_of", lambda _: EVALUATIONS)


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(3))
def test_a_team_works_where_most_proposals_are_lost(seed: int) -> None:
    mission, program = example("depot")
    network = NetworkKnobs(LinkKnobs(loss_permille=600))
    result = simulate(mission, program, seed=seed, network=network)
    assert (result.result, result.violations) == ("success", []), f"seed {seed}"


class Liar(Scheduler):
    """Proposes at once what is no schedule, and then what costs more than what it has found.

    It cannot say that this costs less: no proposal has a cost.
    """

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._lies = itertools.cycle(("incomplete", "mixed up", "backwards", "bad"))

    def _propose(self, proposal: Proposal, ahead: Lookahead, now_us: int) -> None:
        steps = [each for each in proposal.steps if each.activation in ahead.numbers]
        match next(self._lies):
            case "incomplete":
                del steps[::2]
            case "mixed up":
                robots = [step.robots for step in reversed(steps)]
                steps = [
                    records.ProposedStep(step.activation, each)
                    for step, each in zip(steps, robots, strict=True)
                ]
            case "backwards":
                steps.reverse()
            case _:
                order = [ahead.numbers[step.activation] for step in reversed(steps)]
                order += sorted(set(range(len(ahead.opens))) - set(order))
                steps = list(
                    ahead.proposal(Dispatcher(ahead.problem).dispatch(order).schedule).steps
                )
        self._context.write([(records.SCHEDULE, Proposal(tuple(steps)))], now_us)


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(3))
def test_false_proposals_do_not_harm_the_team(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    mission, program = example("depot")
    kill = [(6 * SECOND_US, Kill("C2"))]
    honest = simulate(mission, program, seed=seed, schedule=kill, inspect=False)

    liars = []

    def some_lie(context: Context) -> Scheduler:
        if context.me != "C1":
            return Scheduler(context)
        liars.append(Liar(context))
        return liars[-1]

    monkeypatch.setattr(scheduler, "Scheduler", some_lie)
    result = simulate(mission, program, seed=seed, schedule=kill)
    assert liars, "the test replaces nothing"
    assert (result.result, result.violations) == ("success", []), f"seed {seed}"
    # Its schedules are in force until others have found a better one, for 0.3 s of a search.
    assert result.duration_us <= honest.duration_us + 2 * SECOND_US, f"seed {seed}"


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(3))
def test_both_halves_of_a_team_work_on_and_then_have_one_schedule(seed: int) -> None:
    mission, program = example("depot")
    links = {pair for a in LEFT for b in RIGHT for pair in ((a, b), (b, a))}
    schedule = [(4 * SECOND_US, Block(frozenset(links))), (12 * SECOND_US, Unblock())]
    whole = simulate(mission, program, seed=seed, schedule=schedule)
    assert (whole.result, whole.violations) == ("success", []), f"seed {seed}"
    begun = {
        each["robot"] for each in whole.events if each["event"] != "cancel" and 6 < each["t"] < 12
    }
    assert begun & set(LEFT), f"seed {seed}"
    assert begun & set(RIGHT), f"seed {seed}"
    for until_s in (11, 14):
        part = simulate(
            mission,
            program,
            seed=seed,
            schedule=schedule,
            timeout_us=until_s * SECOND_US,
            inspect=False,
        )
        found, teams = set(), set()
        for each in part.agents.values():
            plan = each.view.plan
            assert plan is not None
            assert plan.ahead is not None
            assert plan.ahead.schedule is not None, f"seed {seed}"
            teams.add(plan.ahead.robots)
            # What one has written just now others may not have heard, or planned for.
            if each.view.is_plan_current:
                found.add((each.view.facts.map.digest(), plan.ahead.schedule))
        assert teams == ({LEFT, RIGHT} if until_s == 11 else {tuple(sorted(LEFT + RIGHT))})
        assert len(found) == len({known for known, _ in found}), f"seed {seed}"
