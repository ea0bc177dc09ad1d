"""A team of three, driven by nothing but its agents' inputs and effects."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

from benchmarks.membership.team import SteppedTeam
from benchmarks.walk.trace import Trace, begin, end
from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.sim.world.network import LinkKnobs, NetworkKnobs

MISSION = """\
mission: walk
program: robot.py
parameters: {parts: [1, 2]}
local_tasks:
  unscrew: {work: 1}
  test: {parameters: [part], work: 1}
  weld: {parameters: [part], work: 1}
  lift: {work: 1}
conditions:
  nominal: {default: false}
  broken: {parameters: [part], default: false}
robot_types:
  A: {capabilities: {unscrew: 3, test: 1, weld: 1, lift: 1}}
  B: {capabilities: {test: 3, weld: 2, lift: 1}}
  C: {capabilities: {test: 1, weld: 3, lift: 1}}
robots: {A1: A, B1: B, C1: C}
global_tasks:
  open: {needs: {unscrew: {min: 1, max: 1}}}
  diagnose: {parameters: [part], needs: {test($part): {min: 1, max: 1}}}
  repair: {parameters: [part], needs: {weld($part): {min: 1, max: 2}}}
  close: {simultaneous: true, needs: {lift: {min: 2, max: 2}}}
tree:
  Fallback:
    - Condition: nominal
    - Sequence:
        - open
        - diagnose(1)
        - Fallback: [{Inverter: {Condition: broken(1)}}, repair(1)]
        - diagnose(2)
        - Fallback: [{Inverter: {Condition: broken(2)}}, repair(2)]
        - close
"""
AT_REST_US = 2_000_000
SLICE_US = 100
GIVE_UP_US = 5_000_000
# All that a runtime calls while a robot runs.
STEPS = (Agent.handle.__code__, Agent.next_deadline_us.__code__)


def mission() -> Mission:
    with tempfile.TemporaryDirectory(prefix="mrbt-walk-") as folder:
        path = Path(folder) / "mission.yaml"
        (Path(folder) / "robot.py").write_text("", encoding="utf-8")
        path.write_text(MISSION, encoding="utf-8")
        return load_mission(path)


class Walk:
    """The team, up to where B1 diagnoses the first part: the second action of the run."""

    sender = "B1"

    def __init__(self) -> None:
        self._team = SteppedTeam(mission(), NetworkKnobs(LinkKnobs(jitter_us=0)), seed=1)
        self._team.on_step = self._after_step
        # The other robot that has started an action.
        self.started = ""
        self._is_waiting = False
        self._team.launch_all()
        self._team.run_until(AT_REST_US)
        self._team.end_action("A1")
        self._team.run_until(2 * AT_REST_US)
        assert self._team.at_work() == [self.sender]

    def outcome(self) -> Trace:
        """From B1's diagnosis (the part is broken) to the start of the repair by another robot."""
        conditions = (("broken(1)", True),)
        return self._until_somebody_starts(lambda: self._team.end_action(self.sender, conditions))

    def kill(self) -> Trace:
        """From the death of B1 at its diagnosis until another robot takes over."""
        return self._until_somebody_starts(lambda: self._team.kill(self.sender))

    def _until_somebody_starts(self, event: Callable[[], None]) -> Trace:
        give_up_us = self._team.now_us + GIVE_UP_US
        self._is_waiting = True
        trace = begin(STEPS)
        event()
        while self._is_waiting:
            self._team.run_until(self._team.now_us + SLICE_US)
            if self._team.now_us > give_up_us:
                end()
                raise TimeoutError("no other robot has started an action")
        return trace

    def _after_step(self, agent: AgentView, _: int) -> None:
        if self._is_waiting and agent.robot != self.sender and agent.robot in self._team.at_work():
            end()
            self._is_waiting = False
            self.started = agent.robot
