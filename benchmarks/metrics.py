"""What it costs a robot to count what happens, and to answer requests for its metrics.

    python -m benchmarks.metrics [--beats 20000] [--json FILE]

counting  processor time for the same messages with a meter, against without
asking    processor time for one page, and its share of a robot's time at one page in 5 s
"""

from __future__ import annotations

import statistics
import time
from typing import Any

from benchmarks.membership.team import SteppedTeam
from benchmarks.report import run_program
from benchmarks.run import REPAIR
from mrbt_mesh.adapters.metrics.meter import Meter
from mrbt_mesh.adapters.metrics.pages import robot_page
from mrbt_mesh.adapters.metrics.server import metrics_app
from mrbt_mesh.core.agent.effects import Effect
from mrbt_mesh.core.agent.inputs import Input
from mrbt_mesh.core.membership.timing import SECOND_US, Timing
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.sim.world.network import NetworkKnobs

ROUNDS, SCRAPE_S, PAGES = 101, 5.0, 200


class Talk:
    """A simulated team whose first robot is measured, with or without a meter."""

    def __init__(self, mission: Mission, is_metered: bool) -> None:
        self.spent_ns = 0
        self.taken = 0
        self.first = next(iter(mission.robots))
        self.meter = Meter(self.first, mission) if is_metered else None
        self.team = SteppedTeam(mission, NetworkKnobs(), seed=1)
        self.team.launch_all()
        self.team.run_until(SECOND_US)
        self.team.wrap_handle(self.first, self._timed)

    def _timed(self, handle: Any, event: Input, now_us: int) -> list[Effect]:
        meter, began_ns = self.meter, time.thread_time_ns()
        if meter is not None:
            meter.take(event)
        effects: list[Effect] = handle(event, now_us)
        if meter is not None:
            for effect in effects:
                meter.carry_out(effect)
        self.spent_ns += time.thread_time_ns() - began_ns
        self.taken += 1
        return effects

    def input_us(self, span_us: int) -> float:
        """Let time pass; microseconds for one input of the robot."""
        before_ns, before = self.spent_ns, self.taken
        self.team.run_until(self.team.now_us + span_us)
        return (self.spent_ns - before_ns) / (self.taken - before) / 1e3


def ratio(mission: Mission, beats: int) -> dict[str, float]:
    """Time with a meter by time without, for the same messages, side by side in many slices."""
    plain, metered = Talk(mission, False), Talk(mission, True)
    for talk in (plain, metered):
        talk.input_us(4 * SECOND_US)
    slice_us = beats // ROUNDS * Timing().heartbeat_us // len(mission.robots)
    times = [(plain.input_us(slice_us), metered.input_us(slice_us)) for _ in range(ROUNDS)]
    return {
        "ratio": round(statistics.median(slow / fast for fast, slow in times), 3),
        "input_us": round(statistics.median(fast for fast, _ in times), 1),
    }


def page_ms(mission: Mission, pages: int = PAGES) -> float:
    """Processor time of one page: to read it in the event loop and to write it."""
    talk = Talk(mission, True)
    talk.input_us(4 * SECOND_US)
    meter, view = talk.meter, talk.team.agent(talk.first)
    assert meter is not None
    app = metrics_app(lambda: robot_page(view, meter))
    environ: dict[str, Any] = {"PATH_INFO": "/metrics", "REQUEST_METHOD": "GET"}
    began_ns = time.thread_time_ns()
    for _ in range(pages):
        list(app(environ, lambda *_: lambda _: None))
    return round((time.thread_time_ns() - began_ns) / pages / 1e6, 3)


def measure(beats: int = 20_000) -> dict[str, Any]:
    """Both, for the vehicle repair."""
    mission = load_mission(REPAIR)
    page = page_ms(mission)
    share = round(100 * page / 1e3 / SCRAPE_S, 3)
    return {**ratio(mission, beats), "page_ms": page, "page_share_percent": share}


if __name__ == "__main__":
    run_program(__doc__, measure)
