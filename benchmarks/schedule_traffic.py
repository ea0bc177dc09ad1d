"""What schedules cost a team: their messages, how long one is checked, and when a new one is there.

    python -m benchmarks.schedule_traffic [--robots 15 50] [--json FILE]

Random cases of the form of `benchmarks.allocation`, with four tasks for three robots, in the
simulator: the real agents, in virtual time. Schedules hold up to 100 tasks. In the middle of the
mission a robot dies. Counted is what reaches an observer; a search takes 0.3 s there.
"""

from __future__ import annotations

import random
import statistics
import time
from typing import Any

from benchmarks.allocation import mission_of, program_of
from benchmarks.report import grid, run_program, say
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import Proposal
from mrbt_mesh.core.facts.store import Entry, Version
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.sim.run import simulate
from mrbt_mesh.sim.world.faults import Kill

SECOND_US = 1_000_000
SKILLS = 5
DEATH_US, END_US = 6 * SECOND_US, 9 * SECOND_US
# From here until the death no robot comes or goes, and works begin and end.
REST_US = 3 * SECOND_US
CHECKS = 20


def drawn_case(robots: int) -> dict[str, Any]:
    """Robots of five skills and tasks for one to four of these, anywhere in the unit square."""
    draw = random.Random(robots)
    tasks = {
        str(number): {
            "at": [draw.random(), draw.random()],
            "duration_s": draw.uniform(1, 5),
            "skills": sorted(draw.sample(range(SKILLS), draw.randrange(1, SKILLS))),
        }
        for number in range(robots * 4 // 3)
    }
    team = {
        str(number): {"at": [draw.random(), draw.random()], "skill": number % SKILLS}
        for number in range(robots)
    }
    return {"case": robots, "tasks": tasks, "robots": team}


def measure_team(robots: int) -> dict[str, Any]:
    """One team: counts, bytes, milliseconds."""
    mission, dead = mission_of(drawn_case(robots), plain=False), f"R{robots // 2}"
    seen: dict[tuple[str, Version], tuple[int, Entry]] = {}

    def look(observer: Observer, now_us: int) -> None:
        for robot in observer.facts.proposals:
            entry = observer.facts.map.get(robot, records.SCHEDULE)
            if entry is not None:
                seen.setdefault((robot, entry.version), (now_us, entry))

    result = simulate(
        mission,
        program_of(mission),
        seed=1,
        schedule=[(DEATH_US, Kill(dead))],
        timeout_us=END_US,
        inspect=False,
        look_on=look,
    )
    plan = next(each.view.plan for name, each in result.agents.items() if name != dead)
    assert plan is not None
    assert plan.ahead is not None
    proposal = result.observer.facts.proposals[plan.ahead.author]
    checks_ms = []
    for _ in range(CHECKS):
        begun_ns = time.perf_counter_ns()
        assert plan.ahead.mended(proposal).schedule
        checks_ms.append((time.perf_counter_ns() - begun_ns) / 1e6)
    after_us = [at_us for at_us, each in seen.values() if at_us > DEATH_US and _is_new(each, dead)]
    sizes = [len(each.packed) for _, each in seen.values()]
    return {
        "robots": robots,
        "messages": len(seen),
        "bytes": sum(sizes),
        "largest": max(sizes),
        "at_rest": sum(REST_US < at_us <= DEATH_US for at_us, _ in seen.values()),
        "check_ms": round(statistics.median(checks_ms), 2),
        "first_ms": round((min(after_us) - DEATH_US) / 1e3),
    }


def _is_new(entry: Entry, dead: str) -> bool:
    """Whether this is a schedule without the robot that has died."""
    record = entry.record
    assert isinstance(record, Proposal)
    robots = {robot for step in record.steps for each in step.robots for robot in each}
    return bool(robots) and dead not in robots


def measure(robots: tuple[int, ...] = (15, 50)) -> dict[str, Any]:
    """All teams, and the table for the page."""
    rows = []
    for count in robots:
        say(f"{count} robots")
        rows.append(measure_team(count))
    head = ["robots", "messages, with a death", "bytes of all", "of the largest"]
    head += ["messages in 3 s at rest", "check of one", "death until a new schedule"]
    table = grid(
        head,
        [
            (
                row["robots"],
                row["messages"],
                row["bytes"],
                row["largest"],
                row["at_rest"],
                f"{row['check_ms']} ms",
                f"{row['first_ms']} ms",
            )
            for row in rows
        ],
    )
    return {"rows": rows, "tables": {"traffic": table}}


if __name__ == "__main__":
    run_program(__doc__, measure)
