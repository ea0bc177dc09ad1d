"""The workshop's world: MuJoCo steps bodies, and tools do something where their tip is.

It knows nothing of tasks or teams. Robots send commands and receive what they sense; `judged`
returns what is out, off and mended, as it lies there. The same commands at the same times give the
same world, to the bit.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from bodies.messages import (
    HARDWARE,
    PROBE,
    RANGE_M,
    RAYS,
    SCREW,
    SOLDER,
    UNSCREW,
    WIRES,
    AtTip,
    Command,
    Fork,
    Senses,
)
from mrbt_mesh import InputError

try:
    import mujoco
except ImportError:
    text = "the workshop's world needs more: pip install 'mrbt-mesh[world]'"
    raise InputError(text) from None

MODEL = Path(__file__).with_name("workshop.xml")
BROKEN = ("2", "4")
# A command that is not renewed holds so long: then a base stops by itself.
COMMAND_HOLDS_S = 0.25
ACCELERATION, TURN_ACCELERATION = 1.5, 4.0
ARM_SPEED, FORK_SPEED = 1.0, 0.15
# How near a tip has to be to what it works on, and a screw to its hole.
SCREW_NEAR_M, PART_NEAR_M, HOLE_NEAR_M = 0.05, 0.08, 0.03
LIDAR_HEIGHT_M = 0.2
# What the judge lets pass as being in its place.
IN_PLACE_M, IN_PLACE_RAD = 0.03, 0.03
PARTS = ("1", "2", "3", "4", "5")
SCREWS = ("1", "2", "3", "4")


@dataclass(frozen=True)
class Kind:
    """A type of robot: its speed in m/s, and what its tools do in a second, 1 being all of it."""

    speed: float
    tools: dict[str, float]


KINDS = {
    "A": Kind(1.2, {PROBE: 1.0, HARDWARE: 0.5, WIRES: 0.5}),
    "B": Kind(1.2, {PROBE: 0.33, HARDWARE: 0.33, WIRES: 0.33, SOLDER: 0.33}),
    "C": Kind(1.0, {UNSCREW: 0.6, SCREW: 0.6}),
}
Place: TypeAlias = tuple[float, float]


class Part:
    """One part of the vehicle. `done`: how far hardware, wires and solder are, each 0 to 1."""

    def __init__(self, broken: bool) -> None:
        self.is_broken = broken
        self.done = {HARDWARE: 0.0 if broken else 1.0, WIRES: 1.0, SOLDER: 1.0}

    def worked(self, tool: str, share: float) -> bool:
        """Let a tool work on it; True when that is finished by this.

        New hardware has no wires yet, and nothing is soldered before its wires are there.
        """
        if self.done[tool] >= 1:
            return False
        if tool == HARDWARE:
            self.done |= {WIRES: 0.0, SOLDER: 0.0}
        before = {WIRES: HARDWARE, SOLDER: WIRES}.get(tool)
        if before is not None and self.done[before] < 1:
            return False
        self.done[tool] = min(1.0, self.done[tool] + share)
        if tool == HARDWARE and self.done[tool] >= 1:
            self.is_broken = False
        return self.done[tool] >= 1


class Robot:
    """One robot's body in the model: its joints, and the last command."""

    def __init__(self, model: Any, name: str) -> None:
        self.name = name
        self.kind = KINDS[name[0]]
        self.base = model.body(f"{name}/base").id
        self.tip = model.site(f"{name}/tip").id
        joints = [j for j in ("x", "y", "turn", "arm", "reach", "fork") if _has(model, name, j)]
        self.motors = {j: int(model.actuator(f"{name}/{j}").id) for j in joints}
        self.angles = {j: int(model.joint(f"{name}/{j}").qposadr[0]) for j in joints}
        self.speeds = {j: int(model.joint(f"{name}/{j}").dofadr[0]) for j in joints}
        self.command = Command()
        # What each motor is given now.
        self.given = dict.fromkeys(joints, 0.0)
        self.commanded_s = -math.inf
        # The part under the probe, and how far the measurement is.
        self.probed = ("", 0.0)


def _has(model: Any, name: str, joint: str) -> bool:
    return bool(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, f"{name}/{joint}") >= 0)


class World:
    """The workshop, `time_s` seconds after its begin. `events`: what has happened in it."""

    def __init__(self, broken: Iterable[str] = BROKEN) -> None:
        broken = set(broken)
        if not broken <= set(PARTS):
            raise InputError(f"parts are {', '.join(PARTS)}, not {', '.join(sorted(broken))}")
        self.model = mujoco.MjModel.from_xml_path(str(MODEL))
        self.data = mujoco.MjData(self.model)
        names = [self.model.body(i).name for i in range(self.model.nbody)]
        bases = sorted(name for name in names if name.endswith("/base"))
        self.robots = {n: Robot(self.model, n) for n in (b.partition("/")[0] for b in bases)}
        self.parts = {name: Part(name in broken) for name in PARTS}
        self.screws = dict.fromkeys(SCREWS, 0.0)
        self.events: list[dict[str, Any]] = []
        self._step_s = float(self.model.opt.timestep)
        self._steps = 0
        self._cover_is_off = False
        self._frame = self.model.body("frame").id
        self._rays = np.arange(RAYS) * (math.tau / RAYS)
        self.settle()

    def settle(self) -> None:
        """Let everything that follows from where the joints are be so."""
        mujoco.mj_forward(self.model, self.data)

    @property
    def time_s(self) -> float:
        return self._steps * self._step_s

    # -- time ----------------------------------------------------------------------------------

    def advance_to(self, time_s: float) -> None:
        """Let the world go on until then, in steps of its own; never back."""
        until = math.floor(time_s / self._step_s + 1e-6)
        while self._steps < until:
            self._step()

    def _step(self) -> None:
        for robot in self.robots.values():
            self._drive(robot)
        mujoco.mj_step(self.model, self.data)
        self._steps += 1
        for robot in self.robots.values():
            if robot.command.tool:
                self._work(robot, self._step_s)
        if self._steps % 20 == 0:
            self._watch_cover()

    def _drive(self, robot: Robot) -> None:
        """Turn a command into what the motors are given: limited speeds, limited accelerations."""
        if self.time_s - robot.commanded_s > COMMAND_HOLDS_S:
            command = robot.command
            robot.command = Command(
                arm_m=command.arm_m, reach_m=command.reach_m, fork_m=command.fork_m
            )
            robot.commanded_s = math.inf
        command, heading = robot.command, self._heading(robot)
        speed = math.hypot(command.forward, command.left)
        scale = min(1.0, robot.kind.speed / speed) if speed else 0.0
        forward, left = command.forward * scale, command.left * scale
        cos, sin = math.cos(heading), math.sin(heading)
        self._approach(robot, "x", forward * cos - left * sin, ACCELERATION)
        self._approach(robot, "y", forward * sin + left * cos, ACCELERATION)
        self._approach(robot, "turn", max(-2.0, min(2.0, command.turn)), TURN_ACCELERATION)
        self._approach(robot, "arm", max(0.0, min(1.0, command.arm_m)), ARM_SPEED)
        if "fork" in robot.motors:
            self._approach(robot, "reach", max(0.0, min(0.4, command.reach_m)), ARM_SPEED)
            self._approach(robot, "fork", max(0.0, min(0.5, command.fork_m)), FORK_SPEED)

    def _approach(self, robot: Robot, joint: str, goal: float, rate: float) -> None:
        now = robot.given[joint]
        if now != goal:
            step = rate * self._step_s
            now += max(-step, min(step, goal - now))
            robot.given[joint] = self.data.ctrl[robot.motors[joint]] = now

    # -- tools ---------------------------------------------------------------------------------

    def _work(self, robot: Robot, passed_s: float) -> None:
        share = robot.kind.tools.get(robot.command.tool, 0.0) * passed_s
        if not share:
            return
        tool, tip = robot.command.tool, self.data.site_xpos[robot.tip]
        if tool in (UNSCREW, SCREW):
            self._turn_screw(tool, tip, share)
            return
        part = self._part_at(tip)
        if part is None or self._covers(part):
            robot.probed = ("", 0.0)
        elif tool == PROBE:
            before = robot.probed[1] if robot.probed[0] == part else 0.0
            robot.probed = (part, min(1.0, before + share))
        elif self.parts[part].worked(tool, share):
            self._happened(f"part {part}: {tool} done by {robot.name}")

    def _turn_screw(self, tool: str, tip: Any, share: float) -> None:
        screw = self._screw_at(tip)
        if screw is None:
            return
        out = self.screws[screw]
        equality = self.model.equality(f"screw_{screw}").id
        if tool == UNSCREW and out < 1:
            self.screws[screw] = min(1.0, out + share)
            if self.screws[screw] >= 1:
                self.data.eq_active[equality] = 0
                self._happened(f"screw {screw} is out")
        elif tool == SCREW and out > 0 and self._is_over_its_hole(screw):
            self.screws[screw] = max(0.0, out - share)
            if self.screws[screw] <= 0:
                self.data.eq_active[equality] = 1
                self._happened(f"screw {screw} is in")

    def _screw_at(self, tip: Any) -> str | None:
        """The screw under a tip that reaches down to the cover where it lies on the vehicle."""
        for name in SCREWS:
            head = self.data.site(f"screw_{name}").xpos
            if _apart(tip, head) < SCREW_NEAR_M and 0 < tip[2] - head[2] < 0.2:
                return name
        return None

    def _is_over_its_hole(self, screw: str) -> bool:
        head = self.data.site(f"screw_{screw}").xpos
        hole = self.data.site(f"hole_{screw}").xpos
        return bool(np.linalg.norm(head - hole) < HOLE_NEAR_M)

    def _part_at(self, tip: Any) -> str | None:
        for name in PARTS:
            if _apart(tip, self.data.site(f"part_{name}").xpos) < PART_NEAR_M:
                return name
        return None

    def _covers(self, part: str) -> bool:
        """Whether the cover is above a part."""
        place = self.data.site(f"part_{part}").xpos - self.data.xpos[self._frame]
        local = self.data.xmat[self._frame].reshape(3, 3).T @ place
        return bool(abs(local[0]) < 1.5 and abs(local[1]) < 0.75)

    # -- robots --------------------------------------------------------------------------------

    def exchange(self, name: str, command: Command) -> Senses:
        """Give a robot's motors a command, from now on, and get what it senses now."""
        robot = self.robots[name]
        robot.command, robot.commanded_s = command, self.time_s
        return self.senses(name)

    def senses(self, name: str) -> Senses:
        robot, data = self.robots[name], self.data
        heading = self._heading(robot)
        x, y = (float(v) for v in data.xpos[robot.base][:2])
        east, north = (float(data.qvel[robot.speeds[joint]]) for joint in ("x", "y"))
        cos, sin = math.cos(heading), math.sin(heading)
        return Senses(
            time_s=self.time_s,
            x=x,
            y=y,
            heading=heading,
            forward=east * cos + north * sin,
            left=north * cos - east * sin,
            arm_m=float(data.qpos[robot.angles["arm"]]),
            ranges_m=self._ranges(robot, x, y, heading),
            at_tip=self._at_tip(robot),
            fork=self._fork(robot),
        )

    def _heading(self, robot: Robot) -> float:
        return math.remainder(float(self.data.qpos[robot.angles["turn"]]), math.tau)

    def _ranges(self, robot: Robot, x: float, y: float, heading: float) -> tuple[float, ...]:
        angles = self._rays + heading
        directions = np.stack([np.cos(angles), np.sin(angles), np.zeros(RAYS)], axis=1)
        found, distances = np.full(RAYS, -1, np.int32), np.full(RAYS, -1.0)
        mujoco.mj_multiRay(
            self.model,
            self.data,
            np.array([x, y, LIDAR_HEIGHT_M]),
            directions.ravel(),
            np.array([1, 0, 0, 0, 0, 0], np.uint8),
            True,
            robot.base,
            found,
            distances,
            None,
            RAYS,
            RANGE_M,
        )
        return tuple(min(float(d), RANGE_M) if d >= 0 else RANGE_M for d in distances)

    def _at_tip(self, robot: Robot) -> AtTip | None:
        tip = self.data.site_xpos[robot.tip]
        screw = self._screw_at(tip)
        if screw is not None and UNSCREW in robot.kind.tools:
            return AtTip(f"screw {screw}", (self.screws[screw],))
        part = self._part_at(tip)
        if part is None:
            return None
        reading = ""
        if robot.probed == (part, 1.0):
            reading = "broken" if self.parts[part].is_broken else "good"
        done = tuple(self.parts[part].done.values())
        return AtTip(f"part {part}", done, reading, self._covers(part))

    def _fork(self, robot: Robot) -> Fork | None:
        if "fork" not in robot.motors:
            return None
        load = max(0.0, float(self.data.actuator_force[robot.motors["fork"]]))
        along = self.data.xmat[self._frame].reshape(3, 3)[:, 0]
        tilt = math.asin(max(-1.0, min(1.0, float(along[2])))) if load > 50 else 0.0
        out, up = (float(self.data.qpos[robot.angles[joint]]) for joint in ("reach", "fork"))
        return Fork(up, out, load, tilt)

    # -- the judge -----------------------------------------------------------------------------

    def judged(self) -> dict[str, Any]:
        """How things lie: screws, the cover, parts; `problems`: why it is not mended."""
        place = self.data.xpos[self._frame] - np.array(self.model.body_pos[self._frame])
        along = self.data.xmat[self._frame].reshape(3, 3)[:, 0]
        yaw, tilt = math.atan2(along[1], along[0]), math.asin(along[2])
        problems = []
        is_in_place = float(np.linalg.norm(place)) <= IN_PLACE_M
        if not is_in_place or max(abs(yaw), abs(tilt)) > IN_PLACE_RAD:
            problems.append("the cover is not in its place")
        problems += [f"screw {name} is not in" for name, out in self.screws.items() if out > 0]
        for name, part in self.parts.items():
            if part.is_broken:
                problems.append(f"part {name} is broken")
            lacks = [tool for tool, done in part.done.items() if done < 1]
            if lacks:
                problems.append(f"part {name} lacks {', '.join(lacks)}")
        return {
            "mended": not problems,
            "problems": problems,
            "cover": {"moved_m": [round(float(v), 4) for v in place], "is_off": self._cover_is_off},
            "screws_out": [name for name, out in self.screws.items() if out >= 1],
            "parts_replaced": [
                event["what"].split()[1][:-1]
                for event in self.events
                if event["what"].partition(": ")[2].startswith(HARDWARE)
            ],
            "robots": {
                name: [round(float(v), 4) for v in self.data.xpos[robot.base][:2]]
                for name, robot in self.robots.items()
            },
            "time_s": round(self.time_s, 3),
            "events": self.events,
        }

    def _watch_cover(self) -> None:
        is_off = not any(self._covers(part) for part in PARTS)
        if is_off != self._cover_is_off:
            self._cover_is_off = is_off
            self._happened(f"the cover is {'off' if is_off else 'on'}")

    def _happened(self, what: str) -> None:
        self.events.append({"at_s": round(self.time_s, 2), "what": what})


def _apart(a: Any, b: Any) -> float:
    """How far apart two places are, seen from above."""
    return math.hypot(a[0] - b[0], a[1] - b[1])
