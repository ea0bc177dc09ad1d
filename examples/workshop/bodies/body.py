"""A robot's body as its program uses it: senses come in, a command goes out, and what is made of
the two: driving somewhere, standing exactly, reaching for something, working on it.
"""

from __future__ import annotations

import math
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import replace

import anyio

from bodies.driving import Floor, Place, Sights, Site, kept_off
from bodies.link import Link, SocketLink, VirtualLink
from bodies.messages import AtTip, Command, Senses
from mrbt_mesh import RobotContext, TaskFailedError

PERIOD_S, RETRY_S = 0.1, 0.5
REPORTS_EVERY = 2
RADII_M = {"A": 0.28, "B": 0.28, "C": 0.38}
SPEEDS = {"A": 1.2, "B": 1.2, "C": 1.0}
# Where the tip is when the arm is in, from the middle of the base, and how far it gets.
TIP_M = 0.45
LEAST_REACH_M, MOST_REACH_M = 0.75, 1.4
PLAN_EVERY_S, NO_WAY_S, SETTLE_S, STUCK_S, IDLE_S = 0.5, 15.0, 6.0, 10.0, 2.0
TRIES = 8


class Body:
    """One robot's body. `command` is sent ten times a second."""

    def __init__(self, task: RobotContext) -> None:
        floor = task.parameters["floor"]
        site = Site(
            tuple(floor["hall"]),
            tuple(map(tuple, floor["solids"])),
            tuple(map(tuple, floor["lanes"])),
        )
        self.floor = Floor(site, RADII_M[task.robot_type])
        self._sights = Sights(self.floor)
        self.speed = SPEEDS[task.robot_type]
        x, y = task.parameters["map"]["stations"][task.robot]
        self.home: Place = (x, y)
        self.command = Command()
        self._task = task
        self._senses: Senses | None = None
        self._news = anyio.Event()
        self._at_work = 0
        self._is_lost = False
        self._leisure = anyio.CancelScope()

    # -- the link ------------------------------------------------------------------------------

    async def live(self) -> None:
        """Keep the link to the body as long as the robot lives."""
        while True:
            try:
                link = await self._connect()
            except OSError:
                self._lose()
                await anyio.sleep(RETRY_S)
                continue
            try:
                await self._exchange(link)
            except OSError:
                self._lose()
            finally:
                with anyio.CancelScope(shield=True):
                    await link.close()

    async def _connect(self) -> Link:
        if self._task.simulation.is_virtual:
            return VirtualLink(self._task.robot, self._task.unix_time_s)
        return await SocketLink.connect(self._task.robot)

    async def _exchange(self, link: Link) -> None:
        senses = await link.sense()
        # A program that starts again finds its arm and its fork where they are.
        fork = senses.fork
        self.command = Command(
            arm_m=senses.arm_m,
            reach_m=fork.out_m if fork else 0.0,
            fork_m=fork.up_m if fork else 0.0,
        )
        if self._is_lost:
            self._is_lost = False
            self._task.restore_capability("all")
        for count in range(1 << 60):
            senses = await link.exchange(self.command)
            if count % REPORTS_EVERY == 0:
                self._task.report_position(senses.x, senses.y, heading=senses.heading)
            self._senses = senses
            self._news.set()
            self._news = anyio.Event()
            await anyio.sleep(PERIOD_S)

    def _lose(self) -> None:
        """Without a body a robot can do nothing."""
        if not self._is_lost:
            self._is_lost = True
            self._task.lose_capability("all")

    async def tick(self) -> Senses:
        """What is sensed next."""
        await self._news.wait()
        assert self._senses is not None
        return self._senses

    @property
    def place(self) -> Place:
        """Where the robot was last; at home before it has sensed anything."""
        return self.home if self._senses is None else (self._senses.x, self._senses.y)

    # -- duty and leisure ----------------------------------------------------------------------

    @asynccontextmanager
    async def at_work(self) -> AsyncIterator[None]:
        """A local task has the body; in the end it stands still, its tool off and its arm in."""
        self._at_work += 1
        self._leisure.cancel()
        try:
            yield
        finally:
            self._at_work -= 1
            self.stop()
            self.command = replace(self.command, arm_m=0.0)

    async def stand_by(self) -> None:
        """Go home whenever there is nothing to do, out of the others' way; with a load, wait."""
        while True:
            with anyio.CancelScope() as self._leisure:
                while self._at_work:
                    await self.tick()
                await anyio.sleep(IDLE_S)
                if math.dist(self.place, self.home) > 0.5 and not (await self.tick()).is_loaded:
                    await self.drive([self.home])
                await anyio.sleep_forever()
            while self._at_work:
                await self.tick()

    # -- moving --------------------------------------------------------------------------------

    def move(self, senses: Senses, east: float, north: float, turn: float = 0.0) -> None:
        """Drive with a velocity over the floor."""
        cos, sin = math.cos(senses.heading), math.sin(senses.heading)
        self.command = replace(
            self.command,
            forward=east * cos + north * sin,
            left=north * cos - east * sin,
            turn=turn,
        )

    def stop(self) -> None:
        self.command = replace(self.command, forward=0.0, left=0.0, turn=0.0, tool="")

    async def drive(self, goals: Sequence[Place], facing: Place | None = None) -> Place:
        """Drive to the nearest of some places, past whatever stands there, and say which it was.

        It turns towards `facing` as it comes near, else to where it drives. Raises
        TaskFailedError if there is no way for a while.
        """
        way: list[Place] = []
        planned_s = seen_s = -math.inf
        while True:
            senses = await self.tick()
            here, hits = (senses.x, senses.y), self._sights.look(senses)
            if senses.time_s - planned_s >= PLAN_EVERY_S:
                planned_s = senses.time_s
                way = self.floor.plan(here, goals, hits)
            if seen_s < 0 or way:
                seen_s = senses.time_s
            if not way:
                self.stop()
                if senses.time_s - seen_s > NO_WAY_S:
                    raise TaskFailedError("there is no way")
                continue
            left_m = math.dist(here, way[-1])
            if left_m < 0.15:
                self.stop()
                return way[-1]
            self._follow(senses, way, hits, facing if left_m < 1.5 else None)
            while len(way) > 1 and math.dist(here, way[0]) < 0.25:
                del way[0]

    def _follow(
        self, senses: Senses, way: list[Place], hits: list[Place], facing: Place | None
    ) -> None:
        here = (senses.x, senses.y)
        aim = self.floor.aim(here, way, hits)
        angle = math.atan2(aim[1] - here[1], aim[0] - here[0])
        speed = min(self.speed, 0.15 + 1.2 * math.dist(here, way[-1]))
        clear_m = self.floor.radius_m + 0.12
        east, north = kept_off(
            speed * math.cos(angle), speed * math.sin(angle), here, hits, clear_m
        )
        towards = angle if facing is None else _angle(here, facing)
        self.move(senses, east, north, 2.0 * math.remainder(towards - senses.heading, math.tau))

    async def settle(self, place: Place, heading: float, *, speed: float = 0.4) -> bool:
        """Go straight to a place nearby and stand there exactly; False if something prevents it."""
        begun_s: float | None = None
        calm = 0
        while True:
            senses = await self.tick()
            begun_s = senses.time_s if begun_s is None else begun_s
            east, north = place[0] - senses.x, place[1] - senses.y
            turn = math.remainder(heading - senses.heading, math.tau)
            calm = calm + 1 if math.hypot(east, north) < 0.012 and abs(turn) < 0.015 else 0
            if calm >= 3:
                self.stop()
                return True
            if senses.time_s - begun_s > SETTLE_S:
                self.stop()
                return False
            self.steer(senses, place, heading, speed=speed)

    def steer(self, senses: Senses, place: Place, heading: float, *, speed: float) -> None:
        """A velocity towards a place, the smaller the nearer it is."""
        east, north = 3 * (place[0] - senses.x), 3 * (place[1] - senses.y)
        scale = min(1.0, speed / max(math.hypot(east, north), 1e-9))
        turn = 3 * math.remainder(heading - senses.heading, math.tau)
        self.move(senses, east * scale, north * scale, turn)

    # -- the arm -------------------------------------------------------------------------------

    async def reach(self, target: Place) -> None:
        """Drive to where the arm gets to a target, and put the tip there.

        Raises TaskFailedError where nobody can stand.
        """
        self.command = replace(self.command, arm_m=0.0)
        while (await self.tick()).arm_m > 0.1:
            pass
        docks = self.floor.docks(target, LEAST_REACH_M, MOST_REACH_M)
        for _ in range(TRIES):
            try:
                dock = await self.drive(docks, facing=target)
            except TaskFailedError:
                # Rather in the way of the cover than not at all.
                docks = self.floor.docks(target, LEAST_REACH_M, MOST_REACH_M, in_lanes=True)
                dock = await self.drive(docks, facing=target)
            if await self.settle(dock, _angle(dock, target)):
                break
            docks = [each for each in docks if math.dist(each, dock) > 0.3]
        else:
            raise TaskFailedError("there is no place to work from")
        out_m = math.dist(dock, target) - TIP_M
        self.command = replace(self.command, arm_m=out_m)
        while abs((await self.tick()).arm_m - out_m) > 0.01:
            pass

    async def apply(self, tool: str, what: str, is_done: Callable[[AtTip], bool]) -> AtTip:
        """Let a tool work on what is at the tip until that is done. Raises TaskFailedError."""
        before: tuple[float, ...] = ()
        moved_s = 0.0
        try:
            while True:
                senses = await self.tick()
                tip = senses.at_tip
                if tip is None or tip.name != what:
                    raise TaskFailedError(f"there is no {what} at the tip")
                if tip.covered:
                    raise TaskFailedError(f"the cover is above {what}")
                if is_done(tip):
                    return tip
                if tip.done != before or not moved_s:
                    before, moved_s = tip.done, senses.time_s
                if senses.time_s - moved_s > STUCK_S:
                    raise TaskFailedError(f"the {tool} tool makes no progress on {what}")
                self.command = replace(self.command, tool=tool)
        finally:
            self.stop()


def _angle(start: Place, end: Place) -> float:
    return math.atan2(end[1] - start[1], end[0] - start[0])
