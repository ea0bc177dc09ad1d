"""Random faults for a team: one seed decides how many of which kind, on whom, and when.

Every seed turns a random half of the kinds of fault off, so that no kind always hides another
(swarm testing). All faults end at one moment; from then on the team has to converge and to finish
what it can, as in TigerBeetle's simulator. Some worlds keep one broken link.
"""

from __future__ import annotations

import dataclasses
import math
import random
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import permutations
from typing import Any

from mrbt_mesh.core.facts.records import JOB, JOB_CANCELLED, JOB_HOLD, JOB_PRIORITY, PAUSED, Hold
from mrbt_mesh.core.feature import features
from mrbt_mesh.core.mission.compiled import compile_mission
from mrbt_mesh.core.mission.mission import MICRO, Mission
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.sim.chaos.vary import varied
from mrbt_mesh.sim.world import faults
from mrbt_mesh.sim.world.network import Link, LinkKnobs
from mrbt_mesh.sim.world.scenario import Scenario, Step
from mrbt_mesh.sim.world.setup import LAUNCH_UNIX_US

MS = 1_000
SECOND_US = 1_000_000


@dataclass(frozen=True, slots=True)
class ChaosKnobs:
    """How much chaos: the mean number of faults of each kind in a run, 0 for none.

    `chaos_us`: its length, `longest_us`: that of a single fault, `max_down`: the most robots that
    are dead, frozen or absent at once (`team_crashes` take all), `quiet_us`: the time of the team
    afterwards. Chances, from 0 to 1: `returns` that a killed robot is started again before the end
    of the chaos, `revived` otherwise after it, `performance_changes` that performances change,
    `bad_disks` that disks are slow, full or locked, `revisions` that the mission is revised.
    """

    chaos_us: int = 6 * SECOND_US
    quiet_us: int = 60 * SECOND_US
    longest_us: int = 6 * SECOND_US
    max_down: int = 2
    returns: float = 0.7
    revived: float = 0.7
    stays: float = 0.7
    kills: float = 2.0
    team_crashes: float = 0.3
    lost_disks: float = 0.2
    freezes: float = 0.7
    suspends: float = 0.5
    slow: float = 0.7
    skewed_clocks: float = 1.0
    clock_jumps: float = 0.3
    partitions: float = 0.7
    one_way: float = 0.7
    broken_links: float = 0.7
    disturbances: float = 1.0
    lost_tokens: float = 0.7
    leaves: float = 0.5
    minor_faults: float = 0.7
    late_joins: float = 0.5
    pauses: float = 0.3
    replays: float = 0.7
    garbage: float = 0.7
    performance_changes: float = 0.5
    bad_disks: float = 0.5
    revisions: float = 0.0


_NAMES = [field.name for field in dataclasses.fields(ChaosKnobs)]
_RATES = _NAMES[_NAMES.index("kills") : _NAMES.index("garbage") + 1]


def draw_knobs(seed: int, robots: int, base: ChaosKnobs | None = None) -> ChaosKnobs:
    """The knobs of one seed: some kinds off, the others more or less than usual."""
    knobs, pick = base or ChaosKnobs(), random.Random(f"{seed}/knobs")
    rates: dict[str, Any] = {
        name: 0.0 if pick.random() < 0.5 else getattr(knobs, name) * 4 ** pick.uniform(-0.5, 1)
        for name in _RATES
    }
    return dataclasses.replace(
        knobs,
        **rates,
        chaos_us=round(knobs.chaos_us * 4 ** pick.uniform(-1, 0.5)),
        longest_us=round(knobs.longest_us * 4 ** pick.uniform(-1.5, 0.5)),
        max_down=pick.randint(1, max(1, robots)),
        returns=pick.choice([0.0, knobs.returns, 1.0]),
        revived=pick.choice([0.0, knobs.revived, 1.0]),
        stays=float(pick.random() < knobs.stays),
    )


def chaos(mission: Mission, seed: int, knobs: ChaosKnobs, speed: float = 1.0) -> Scenario:
    """The chaos of one seed for a mission's robots."""
    return _Chaos(mission, seed, knobs).draw(speed)


def _plan_delay_us(seed: int) -> int | None:
    """Some teams make their plans outside of their agents, and some of these slowly."""
    pick = random.Random(f"{seed}/plans")
    return pick.choice([0, 2 * MS, 10 * MS, 50 * MS]) if pick.random() < 0.25 else None


class _Chaos:
    def __init__(self, mission: Mission, seed: int, knobs: ChaosKnobs) -> None:
        self.seed = seed
        self.knobs = knobs
        self.mission = mission
        self.leases = mission.has_tasks_at_most_once
        self.job_types = [mission.jobs[name] for name in sorted(mission.jobs)]
        self.robots = sorted(mission.robots)
        self.links: list[Link] = list(permutations(self.robots, 2))
        self.local_tasks = {
            robot: sorted({*capabilities, *map(type_name, capabilities), "all"})
            for robot, capabilities in (
                (robot, mission.robots[robot].capabilities) for robot in self.robots
            )
        }
        self.pick = random.Random(f"{seed}/chaos")
        self.steps: list[Step] = []
        self.down: list[tuple[int, int]] = []
        self.dead: set[str] = set()
        self.broken: frozenset[Link] = frozenset()
        # Faults of one burst overlap; without bursts they are spread evenly.
        count = self.pick.choice([0, 0, 1, 2, 3])
        self.bursts = [self.pick.randrange(knobs.chaos_us) for _ in range(count)]

    def draw(self, speed: float) -> Scenario:
        knobs = self.knobs
        late = self._latecomers()
        makers: tuple[tuple[float, Callable[[], None]], ...] = (
            (knobs.kills, partial(self._kill, keeps_journal=True)),
            (knobs.lost_disks, partial(self._kill, keeps_journal=False)),
            (knobs.team_crashes, self._crash_team),
            (knobs.freezes, partial(self._stop, faults.Freeze)),
            (knobs.suspends, partial(self._stop, faults.Suspend)),
            (knobs.slow, self._slow_down),
            (knobs.skewed_clocks, self._skew_clock),
            (knobs.clock_jumps, self._jump_clock),
            (knobs.partitions, self._partition),
            (knobs.one_way, self._block_one_way),
            (knobs.broken_links, self._break_link),
            (knobs.disturbances, self._disturb),
            (knobs.lost_tokens, self._lose_token),
            (knobs.leaves, self._leave),
            (knobs.minor_faults, self._lose_capability),
            (knobs.pauses, self._pause),
            (knobs.replays, self._replay),
            (knobs.garbage, self._send_garbage),
        )
        for mean, make in makers:
            for _ in range(self._count(mean)):
                make()
        self._change_performances()
        self._spoil_disks()
        if self.job_types:
            self._submit_jobs()
            self._set_wall_clocks()
        self._revise()
        for feature in features():
            if (chaos := feature.chaos(self.seed)) is not None:
                self.steps += chaos.steps(self.mission, self.robots, knobs.chaos_us)
        lost = {robot for robot in sorted(self.dead) if self.pick.random() >= knobs.revived}
        heal = faults.Heal(tuple(r for r in self.robots if r not in lost), self.broken)
        # Whatever has not ended by then ends with the healing.
        steps = [step for step in self.steps if step[0] < knobs.chaos_us]
        steps.append((knobs.chaos_us, heal))
        return Scenario(
            seed=self.seed,
            robots=tuple(robot for robot in self.robots if robot not in late),
            steps=tuple(sorted(steps, key=lambda step: step[0])),
            heal_us=knobs.chaos_us,
            timeout_us=knobs.chaos_us + knobs.quiet_us,
            link=self._usual(),
            token_delay_us=self.pick.choice([1 * MS, 5 * MS, 5 * MS, 50 * MS, None]),
            speed=speed,
            stays=bool(knobs.stays),
            plan_delay_us=_plan_delay_us(self.seed),
        )

    def _spoil_disks(self) -> None:
        """Drawn apart, too: disks that are slow, full, or locked when a process starts."""
        pick = random.Random(f"{self.seed}/disks")
        if pick.random() >= self.knobs.bad_disks:
            return
        for _ in range(pick.randint(1, 4)):
            robots = self.robots if pick.random() < 0.25 else [pick.choice(self.robots)]
            start_us = pick.randrange(self.knobs.chaos_us)
            end_us = start_us + pick.randint(10 * MS, self.knobs.longest_us)
            sync_us = pick.choice([0, 5 * MS, 50 * MS, 300 * MS, SECOND_US])
            fails, is_locked = pick.choice([(False, False), (True, False), (True, True)])
            for robot in robots:
                self.steps.append((start_us, faults.Disk(robot, sync_us, fails, is_locked)))
                if pick.random() < 0.75:  # else until the healing
                    self.steps.append((end_us, faults.Disk(robot)))

    def _set_wall_clocks(self) -> None:
        """Drawn apart: the wall clock of one robot is wrong, jumps and drifts."""
        pick = random.Random(f"{self.seed}/wall clocks")
        robot = pick.choice(self.robots)
        for _ in range(pick.choice([0, 1, 2, 4])):
            at_us = pick.choice([0, pick.randrange(self.knobs.chaos_us)])
            ahead_us = pick.choice([-1, 1]) * round(MS * 10 ** pick.uniform(1, 8))
            drift_ppm = pick.choice([0, pick.randint(-500, 500)])
            self.steps.append((at_us, faults.SetWallClock(robot, ahead_us, drift_ppm)))

    def _revise(self) -> None:
        """Drawn apart: up to three revisions, also back to the mission at first."""
        pick = random.Random(f"{self.seed}/revisions")
        if pick.random() >= self.knobs.revisions:
            return
        mission = self.mission
        for _ in range(pick.randint(1, 3)):
            mission = self.mission if pick.random() < 0.15 else varied(mission, pick)
            revise = faults.Revise(
                pick.choice(self.robots), compile_mission(mission), pick.random() < 0.7
            )
            self.steps.append((pick.randrange(self.knobs.chaos_us), revise))

    def _submit_jobs(self) -> None:
        """Drawn apart: jobs, some of them submitted twice, and changes of them."""
        pick, launch_us = random.Random(f"{self.seed}/jobs"), LAUNCH_UNIX_US
        for number in range(pick.randint(3, 25)):
            at_us = pick.randrange(self.knobs.chaos_us)
            name, kind = f"j{number}", pick.choice(self.job_types)
            arguments = [str(pick.randint(1, 3))]
            not_before_us, usual_us = 0, kind.deadline_us
            deadline_us = launch_us + at_us + usual_us if usual_us is not None else 0
            if pick.random() < 0.2:
                not_before_us = launch_us + at_us + pick.randrange(3 * SECOND_US)
            if pick.random() < 0.2:
                deadline_us = launch_us + at_us + pick.randrange(10 * SECOND_US)
                deadline_us = max(not_before_us + 1, deadline_us)
            job = [kind.name, arguments, kind.priority, not_before_us, deadline_us, number]
            for _ in range(pick.choice([1, 1, 2])):
                self._operate(pick, at_us, f"{JOB}/{name}", job)
                at_us += pick.choice([0, 0, pick.randrange(SECOND_US)])
            changes = (
                (JOB_CANCELLED, True),
                (JOB_HOLD, str(pick.choice([Hold.HELD, Hold.NOW]))),
                (JOB_HOLD, str(Hold.RELEASED)),
                (JOB_PRIORITY, pick.randint(0, 5)),
            )
            for _ in range(pick.choice([0, 0, 1, 2])):
                field, value = pick.choice(changes)
                self._operate(pick, at_us + pick.randrange(3 * SECOND_US), f"{field}/{name}", value)

    def _operate(self, pick: random.Random, at_us: int, name: str, value: Any) -> None:
        """A client commands this at some of the robots."""
        robot, *also = pick.sample(self.robots, pick.randint(1, len(self.robots)))
        self.steps.append((at_us, faults.Operate(robot, name, value, "chaos", tuple(also))))

    # -- times and victims --------------------------------------------------------------------

    def _count(self, mean: float) -> int:
        """A number with this mean: geometric, so that now and then there are many."""
        count = 0
        while count < 20 and self.pick.random() < mean / (1 + mean):
            count += 1
        return count

    def _time(self) -> int:
        if self.bursts and self.pick.random() < 0.7:
            at_us = self.pick.choice(self.bursts) + self._length(10 * MS, SECOND_US)
            return min(at_us, self.knobs.chaos_us - 1)
        return self.pick.randrange(self.knobs.chaos_us)

    def _length(self, least_us: int, most_us: int) -> int:
        """Between the two; each order of magnitude is as likely as any other."""
        ratio = max(most_us, least_us) / least_us
        return round(least_us * math.exp(math.log(ratio) * self.pick.random()))

    def _span(self) -> tuple[int, int]:
        """When something begins and ends."""
        start_us = self._time()
        return start_us, start_us + self._length(100 * MS, self.knobs.longest_us)

    def _robot(self) -> str:
        return self.pick.choice(self.robots)

    def _takes_down(self, start_us: int, end_us: int) -> bool:
        """Whether one more robot may be down then; if so, it is noted."""
        others = sum(start < end_us and start_us < end for start, end in self.down)
        if others >= self.knobs.max_down:
            return False
        self.down.append((start_us, end_us))
        return True

    def _during(self, start: faults.Fault, end: faults.Fault) -> None:
        start_us, end_us = self._span()
        self.steps.append((start_us, start))
        if self.pick.random() < 0.75:  # else it lasts until the healing
            self.steps.append((end_us, end))

    def _some_links(self) -> frozenset[Link]:
        count = self.pick.randint(1, max(1, len(self.links) // 2))
        return frozenset(self.pick.sample(self.links, min(count, len(self.links))))

    # -- the kinds of fault -------------------------------------------------------------------

    def _latecomers(self) -> list[str]:
        """Robots that come in the middle of the mission for the first time; never all."""
        count = min(self._count(self.knobs.late_joins), len(self.robots) - 1)
        late = sorted(self.pick.sample(self.robots, count))
        self.steps += [(self._time(), faults.Restart(robot)) for robot in late]
        return late

    def _kill(self, keeps_journal: bool) -> None:
        robot, (start_us, end_us) = self._robot(), self._span()
        returns = self.pick.random() < self.knobs.returns
        if not self._takes_down(start_us, end_us if returns else self.knobs.chaos_us):
            return
        self.steps.append((start_us, faults.Kill(robot)))
        if returns:
            self.steps.append((end_us, faults.Restart(robot, keeps_journal)))
        else:
            self.dead.add(robot)

    def _crash_team(self) -> None:
        start_us, end_us = self._span()
        spread_us = self.pick.choice([0, 0, 5 * MS, 300 * MS])
        for robot in self.robots:
            self.steps.append((start_us + self.pick.randint(0, spread_us), faults.Kill(robot)))
            back_us = end_us + self._length(MS, SECOND_US)
            self.steps.append((max(back_us, start_us + spread_us + 1), faults.Restart(robot)))

    def _stop(self, make: Callable[[str], faults.Fault]) -> None:
        robot, (start_us, end_us) = self._robot(), self._span()
        if self._takes_down(start_us, end_us):
            self.steps += [(start_us, make(robot)), (end_us, faults.Thaw(robot))]

    def _slow_down(self) -> None:
        robot = self._robot()
        self._during(faults.Slow(robot, self._length(10 * MS, 700 * MS)), faults.Slow(robot, 0))

    def _skew_clock(self) -> None:
        robot = self._robot()
        self.steps.append((0, faults.ClockJump(robot, self._length(MS, 10**6 * SECOND_US))))
        self.steps.append(
            (self._time(), faults.ClockRate(robot, self.pick.randint(-50_000, 50_000)))
        )

    def _jump_clock(self) -> None:
        if self.leases:
            return  # grants run by these clocks, which no real one does of itself
        jump = faults.ClockJump(self._robot(), self._length(100 * MS, 60 * SECOND_US))
        self.steps.append((self._time(), jump))

    def _partition(self) -> None:
        if len(self.robots) < 2:
            return
        mixed = self.pick.sample(self.robots, len(self.robots))
        cuts = sorted(
            self.pick.sample(
                range(1, len(mixed)), min(self.pick.choice([1, 1, 1, 2]), len(mixed) - 1)
            )
        )
        groups = [mixed[a:b] for a, b in zip([0, *cuts], [*cuts, len(mixed)], strict=True)]
        block = faults.partition(*groups)
        if self.pick.random() < 0.3:  # overlapping: one robot still hears both sides
            bridge = self._robot()
            links = frozenset(link for link in block.links if bridge not in link)
            block = faults.Block(links)
        self._during(block, faults.Unblock(block.links))

    def _block_one_way(self) -> None:
        links = self._some_links()
        if self.pick.random() < 0.5:  # a robot that speaks, but does not hear, or hears only
            robot, side = self._robot(), self.pick.choice([0, 1])
            links = frozenset(link for link in self.links if link[side] == robot)
        self._during(faults.Block(links), faults.Unblock(links))

    def _break_link(self) -> None:
        """One link of the mesh: nobody may die of it, as long as a third robot hears both."""
        if len(self.robots) > 2:
            one, other = self.pick.sample(self.robots, 2)
            both = self.pick.random() < 0.7
            links = frozenset({(one, other), (other, one)} if both else {(one, other)})
            self._during(faults.Block(links), faults.Unblock(links))
            if self.pick.random() < 0.5:
                self.broken = links

    def _disturb(self) -> None:
        pick = self.pick
        link = LinkKnobs(
            delay_us=self._length(100, 100 * MS),
            jitter_us=self._length(100, 300 * MS),
            loss_permille=pick.choice([0, pick.randint(1, 300), pick.randint(1, 800)]),
            duplicate_permille=pick.choice([0, pick.randint(1, 500)]),
            reorder_permille=pick.choice([0, pick.randint(1, 500)]),
            reorder_us=self._length(MS, 500 * MS),
        )
        links = None if pick.random() < 0.5 else self._some_links()
        self._during(faults.Disturb(link, links), faults.Settle(links))

    def _lose_token(self) -> None:
        if len(self.robots) > 1:
            robot = self._robot()
            others = [other for other in self.robots if other != robot]
            seen_by = self.pick.sample(others, self.pick.randint(1, len(others)))
            at_us = self._time()
            self.steps += [(at_us, faults.LoseToken(robot, each)) for each in seen_by]

    def _leave(self) -> None:
        robot, (start_us, end_us) = self._robot(), self._span()
        if self._takes_down(start_us, end_us):
            self.steps += [(start_us, faults.Leave(robot)), (end_us, faults.Restart(robot))]

    def _lose_capability(self) -> None:
        robot = self._robot()
        local_task = self.pick.choice(self.local_tasks[robot])
        lose, restore = faults.Lose(robot, local_task), faults.Restore(robot, local_task)
        self._during(lose, restore)

    def _change_performances(self) -> None:
        """Drawn apart: it changes nothing else of a seed. 0 is a minor fault, until the healing."""
        pick = random.Random(f"{self.seed}/performances")
        if pick.random() >= self.knobs.performance_changes:
            return
        for _ in range(pick.randint(1, 4)):
            robot = pick.choice(self.robots)
            known = [task for task in self.local_tasks[robot] if task != "all"]
            value = pick.choice([0, MICRO // 4, MICRO // 2, MICRO, 2 * MICRO, 4 * MICRO])
            at_us = pick.randrange(self.knobs.chaos_us)
            self.steps.append((at_us, faults.ChangePerformance(robot, pick.choice(known), value)))

    def _pause(self) -> None:
        one, other = self._robot(), self._robot()
        pause, resume = (
            faults.Operate(r, PAUSED, w) for r, w in ((one, "pause"), (other, "resume"))
        )
        self._during(pause, resume)

    def _replay(self) -> None:
        if len(self.robots) > 1:
            robot, source = self.pick.sample(self.robots, 2)
            at_us = self._time()
            until_us = self.pick.randint(0, at_us)
            count = self._length(1, 30)
            self.steps.append((at_us, faults.Replay(robot, source, until_us, count)))

    def _send_garbage(self) -> None:
        self.steps.append((self._time(), faults.Garbage(self._robot(), self._length(1, 20))))

    def _usual(self) -> LinkKnobs:
        """How the network behaves when nothing is wrong with it."""
        delay_us = self._length(100, 20 * MS)
        return LinkKnobs(delay_us=delay_us, jitter_us=self._length(100, 2 * delay_us + 1_000))
