"""What it costs a robot to count what happens, and to be asked for it.

    python -m benchmarks.metrics [--beats 20000] [--json FILE]

counting  processor time for the same messages with a meter, against without
asking    processor time for one page, and its share of a robot's time at one page in 5 s
"""

from __future__ import annotations

import statistics
import time
from collections import deque
from typing import Any

from benchmarks.report import script_parser, write_json
from benchmarks.run import REPAIR, say
from mrbt_mesh.adapters.metrics.meter import Meter
from mrbt_mesh.adapters.metrics.pages import robot_page
from mrbt_mesh.adapters.metrics.server import metrics_app
from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.agent.effects import Ask, Effect, Publish, Reply
from mrbt_mesh.core.agent.inputs import (
    AnswerReceived,
    Input,
    MessageReceived,
    QueryReceived,
    TimerFired,
)
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import MessageKind
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.formats.mission_file import load_mission

ROUNDS, STEP_US, SCRAPE_S = 101, 50_000, 5.0
TIMING = Timing()


class Talk:
    """A whole team in one thread, on a clock of its own; the first robot is measured."""

    def __init__(self, mission: Mission, is_metered: bool) -> None:
        self.now_us = 0
        self.spent_ns = 0
        self.taken = 0
        self.agents = {
            robot.id: Agent(mission, self._config(mission, robot.id), 0)
            for robot in mission.robots.values()
        }
        self.first = next(iter(self.agents))
        self.meter = Meter(self.first, mission) if is_metered else None
        self._mail: deque[tuple[str, Input]] = deque()
        self._asked: dict[int, str] = {}

    @staticmethod
    def _config(mission: Mission, robot: str) -> AgentConfig:
        known = mission.robots[robot]
        expected = frozenset(mission.robots)
        able = dict(known.capabilities)
        return AgentConfig(robot, known.type, able, "run", robot, default_solver, TIMING, expected)

    def pass_time(self, until_us: int) -> None:
        """Let everybody do what is due, and hear it."""
        while self.now_us < until_us:
            self.now_us += STEP_US
            self._mail.extend((robot, TimerFired()) for robot in self.agents)
            while self._mail:
                robot, event = self._mail.popleft()
                for effect in self._handle(robot, event):
                    self._carry_out(robot, effect)

    def _handle(self, robot: str, event: Input) -> list[Effect]:
        agent = self.agents[robot]
        if robot != self.first:
            return agent.handle(event, self.now_us)
        meter, began_ns = self.meter, time.thread_time_ns()
        if meter is not None:
            meter.take(event)
        effects = agent.handle(event, self.now_us)
        if meter is not None:
            for effect in effects:
                meter.carry_out(effect)
        self.spent_ns += time.thread_time_ns() - began_ns
        self.taken += 1
        return effects

    def _carry_out(self, robot: str, effect: Effect) -> None:
        match effect:
            case Publish(kind, data, to):
                others = [other for other in to or self.agents if other != robot]
                self._mail.extend((o, MessageReceived(kind, robot, data)) for o in others)
            case Ask(peer, data):
                number = len(self._asked)
                self._asked[number] = robot
                self._mail.append((peer, QueryReceived(number, MessageKind.PULL, data)))
            case Reply(query, pages):
                asker = self._asked[query]
                self._mail.extend((asker, AnswerReceived(robot, page)) for page in pages)
            case _:
                pass


def ratio(mission: Mission, beats: int) -> dict[str, float]:
    """Time with a meter by time without, for the same messages, side by side in many slices."""
    plain, metered = Talk(mission, False), Talk(mission, True)
    for talk in (plain, metered):
        talk.pass_time(5_000_000)
    ratios, per_input_us = [], []
    slice_us = beats // ROUNDS * TIMING.heartbeat_us // len(mission.robots)
    for _ in range(ROUNDS):
        spent = []
        for talk in (plain, metered):
            before_ns, before = talk.spent_ns, talk.taken
            talk.pass_time(talk.now_us + slice_us)
            spent.append((talk.spent_ns - before_ns) / (talk.taken - before))
        ratios.append(spent[1] / spent[0])
        per_input_us.append(spent[0] / 1e3)
    return {
        "ratio": round(statistics.median(ratios), 3),
        "input_us": round(statistics.median(per_input_us), 1),
    }


def page_ms(mission: Mission, pages: int = 200) -> float:
    """Processor time of one page: to read it in the event loop and to write it."""
    talk = Talk(mission, True)
    talk.pass_time(5_000_000)
    assert talk.meter is not None
    meter, view = talk.meter, talk.agents[talk.first].view
    app = metrics_app(lambda: robot_page(view, meter))
    environ: dict[str, Any] = {"PATH_INFO": "/metrics", "REQUEST_METHOD": "GET"}
    began_ns = time.thread_time_ns()
    for _ in range(pages):
        list(app(environ, lambda *_: lambda _: None))
    return round((time.thread_time_ns() - began_ns) / pages / 1e6, 3)


def main() -> None:
    """Measure, and say so."""
    parser = script_parser(__doc__)
    parser.add_argument("--beats", type=int, default=20_000)
    given = parser.parse_args()
    mission = load_mission(REPAIR)
    found = ratio(mission, given.beats)
    page = page_ms(mission)
    share = round(100 * page / 1e3 / SCRAPE_S, 3)
    say(f"counting: {found['ratio']} times the time without ({found['input_us']} us an input)")
    say(f"asking: {page} ms a page, {share} % of one core at a page in {SCRAPE_S:g} s")
    data = found | {"page_ms": page, "page_share_percent": share}
    write_json(data, given.json)


if __name__ == "__main__":
    main()
