"""Cut a failing scenario down to what it takes to fail: delta debugging over its faults.

Source: Zeller and Hildebrandt, "Simplifying and Isolating Failure-Inducing Input" (ddmin).
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterable, Sequence

from mrbt_mesh.sim.world import faults
from mrbt_mesh.sim.world.network import LinkKnobs
from mrbt_mesh.sim.world.scenario import USUAL, Scenario, Step

ROUND_US = (1_000_000, 100_000, 10_000, 1_000)
AFTER_US = 100_000


@dataclasses.dataclass(frozen=True)
class Minimised:
    """The smallest scenario found, after how many runs; `is_done`: within the budget."""

    scenario: Scenario
    runs: int
    is_done: bool


class _OutOfBudgetError(Exception):
    pass


def minimise(
    scenario: Scenario,
    fails: Callable[[Scenario], bool],
    budget_s: float,
    progress: Callable[[int, int], None] = lambda runs, steps: None,
) -> Minimised:
    """The smallest scenario for which `fails` still holds, as far as `budget_s` seconds lead.

    `progress(runs, faults left)` is called after each run. The healing at the end always stays.
    """
    search = _Search(scenario, fails, time.monotonic() + budget_s, progress)
    try:
        search.run()
    except _OutOfBudgetError:
        return Minimised(search.best, search.runs, False)
    return Minimised(search.best, search.runs, True)


class _Search:
    def __init__(
        self,
        scenario: Scenario,
        fails: Callable[[Scenario], bool],
        until_s: float,
        progress: Callable[[int, int], None],
    ) -> None:
        self.best = scenario
        self.runs = 0
        self._fails = fails
        self._until_s = until_s
        self._progress = progress

    def run(self) -> None:
        before = None
        while before != self.best:
            before = self.best
            self._fewer_steps()
            self._simpler_world()
            self._simpler_steps()

    def _try(self, scenario: Scenario) -> bool:
        """Whether this scenario fails too; then it is the best so far."""
        if scenario == self.best:
            return False
        if time.monotonic() > self._until_s:
            raise _OutOfBudgetError
        self.runs += 1
        failed = self._fails(scenario)
        if failed:
            self.best = scenario
        self._progress(self.runs, len(_breaking(self.best)))
        return failed

    def _try_steps(self, steps: Iterable[Step]) -> bool:
        healing = [step for step in self.best.steps if isinstance(step[1], faults.Heal)]
        return self._try(self.best.with_steps([*steps, *healing]))

    def _fewer_steps(self) -> None:
        """ddmin: leave out ever smaller parts of the schedule."""
        steps, parts = _breaking(self.best), 2
        while steps:
            size = -(-len(steps) // parts)
            for start in range(0, len(steps), size):
                if self._try_steps([*steps[:start], *steps[start + size :]]):
                    steps, parts = _breaking(self.best), max(2, parts - 1)
                    break
            else:
                if size == 1:
                    return
                parts = min(len(steps), 2 * parts)

    def _simpler_world(self) -> None:
        """A usual network, prompt tokens, robots that stop at the end, an early healing."""
        self._try(dataclasses.replace(self.best, link=USUAL))
        self._try(dataclasses.replace(self.best, token_delay_us=Scenario.token_delay_us))
        self._try(dataclasses.replace(self.best, stays=False))
        last_us = max((at_us for at_us, _ in _breaking(self.best)), default=0)
        for after_us in (AFTER_US, 10 * AFTER_US, 50 * AFTER_US):
            heal_us = last_us + after_us
            if heal_us >= self.best.heal_us or self._try(_healed_at(self.best, heal_us)):
                return

    def _simpler_steps(self) -> None:
        """Round times, and make each fault as plain as it may be."""
        for index in range(len(_breaking(self.best))):
            for unit_us in ROUND_US:
                at_us, fault = _breaking(self.best)[index]
                if self._replace(index, (at_us // unit_us * unit_us, fault)):
                    break
            for simpler in _simpler(_breaking(self.best)[index][1]):
                at_us, _ = _breaking(self.best)[index]
                if self._replace(index, (at_us, simpler)):
                    break

    def _replace(self, index: int, step: Step) -> bool:
        steps = _breaking(self.best)
        # Kept in its place: an earlier time must not change the order.
        if index and step[0] < steps[index - 1][0]:
            return False
        return self._try_steps([*steps[:index], step, *steps[index + 1 :]])


def _breaking(scenario: Scenario) -> Sequence[Step]:
    """All steps but the healing."""
    return [step for step in scenario.steps if not isinstance(step[1], faults.Heal)]


def _healed_at(scenario: Scenario, heal_us: int) -> Scenario:
    steps = [
        (heal_us if isinstance(fault, faults.Heal) else at_us, fault)
        for at_us, fault in scenario.steps
    ]
    quiet_us = scenario.timeout_us - scenario.heal_us
    healed = dataclasses.replace(scenario, heal_us=heal_us, timeout_us=heal_us + quiet_us)
    return healed.with_steps(steps)


def _simpler(fault: faults.Fault) -> Iterable[faults.Fault]:
    """Plainer faults of the same kind, the plainest first."""
    match fault:
        case faults.Disk(robot, sync_us, True, is_locked):
            yield faults.Disk(robot)
            yield from (faults.Disk(robot, sync_us), faults.Disk(robot, 0, True, False))
            if is_locked and sync_us:
                yield faults.Disk(robot, 0, True, True)
        case faults.Garbage(robot, count) if count > 1:
            yield from (faults.Garbage(robot, n) for n in (1, count // 2))
        case faults.Replay(robot, source, until_us, count) if count > 1:
            yield from (faults.Replay(robot, source, until_us, n) for n in (1, count // 2))
        case faults.Disturb(link, links):
            for field in dataclasses.fields(LinkKnobs):
                usual = getattr(USUAL, field.name)
                if getattr(link, field.name) != usual:
                    yield faults.Disturb(dataclasses.replace(link, **{field.name: usual}), links)
        case faults.Block(links) if len(links) > 1:
            for pair in sorted(links):
                yield faults.Block(links - {pair})
