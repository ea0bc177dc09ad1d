"""What `mrbt demo` adds to a run: it kills a robot and suggests what to try next."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from shlex import quote

import anyio

from mrbt_mesh.cli.command_notes import note_command
from mrbt_mesh.core.facts.records import Phase
from mrbt_mesh.core.mission.mission import performance
from mrbt_mesh.core.mission.names import name_order
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.observer.time_at_work import time_at_work
from mrbt_mesh.recording.folder import observer_file
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.team import Team
from mrbt_mesh.runtime.watcher import Watcher

LOOK_S = 0.2
# In seconds at speed 1: when a robot is killed, the work that it must have left, so that one sees
# another robot take over, and how long the demo waits for a robot with that much work.
KILL_AFTER_S, LEFT_S, PATIENCE_S = 8.0, 2.0, 10.0


class Guide:
    """Kills one robot at work, and suggests the next one to kill. `speed` is that of the robots."""

    def __init__(self, speed: float) -> None:
        self._speed = speed
        self._observer: Observer | None = None
        self._killed = self._next = ""
        self._shown: list[str] = []
        self._problems: list[str] = []

    def hints(self) -> list[str]:
        """What to look at or to try now, to be shown with the team."""
        if not self._killed:
            return [f"After {KILL_AFTER_S / self._speed:g} s this demo kills a robot at work"]
        assert self._observer is not None
        if self._next not in self._observer.membership.members():
            self._next = next_to_kill(self._observer)
        hints = [f"the demo has killed {self._killed}"]
        if self._next and not self._observer.is_over:
            hints.append(f"in another terminal: mrbt kill {self._next}")
        return hints

    def new_hints(self) -> list[str]:
        """Return the hints that are new since the last call, to be printed line by line."""
        before, self._shown = self._shown, self.hints()
        return [hint for hint in self._shown if hint not in before]

    async def kill_one(self, watcher: Watcher, team: Team) -> None:
        """Wait for a robot whose work another one can take over, and kill its process."""
        observer = self._observer = watcher.observer
        while observer.record.result is None:
            await anyio.sleep(LOOK_S)
            now_us = boottime_us()
            late_s = (observer.record.seconds(now_us) or 0.0) - KILL_AFTER_S / self._speed
            if late_s < 0:
                continue
            left_s = LEFT_S if late_s < PATIENCE_S / self._speed else 0.0
            for robot in replaceable(observer):
                if not has_work_left(observer, robot, left_s / self._speed, now_us):
                    continue
                process = team.process(robot)
                if process is not None:
                    os.kill(process.pid, signal.SIGKILL)
                    killed = f"{robot} (pid {process.pid}) killed"
                    # A view occupies the terminal, so a warning is printed with the closing words.
                    note_command(team.run_dir, "demo", killed, warn=self._problems.append)
                    self._killed = robot
                    return

    def closing(self, team: Team) -> list[str]:
        """Return where the recording is, and three commands to try with it."""
        return [
            *self._problems,
            "",
            "The run is recorded. Try:",
            f"  mrbt recording replay {quote(str(observer_file(team.run_dir.path)))}",
            f"  mrbt recording verify {quote(str(team.run_dir.path))}",
            f"  mrbt recording report {quote(str(team.run_dir.path))}",
        ]


def replaceable(observer: Observer) -> Iterator[str]:
    """Yield robots at work that another can replace now and that no global task needs later."""
    members, at_work = observer.facts.members, {}
    free = alive = set(observer.membership.members()) & set(members)
    for robot in observer.robots():
        claim = observer.claim(robot)
        if claim is not None:
            free = free - {robot}
            at_work[robot] = claim

    def able(robots: set[str], local_task: str) -> int:
        return sum(
            performance(members[robot].member.capabilities, local_task) is not None
            for robot in robots
        )

    needs = [need for task in observer.mission.global_tasks.values() for need in task.needs]
    for robot, claim in at_work.items():
        if (
            claim.phase is Phase.RUNNING
            and able(free, claim.local_task)
            and all(able(alive - {robot}, need.local_task) >= need.min_robots for need in needs)
        ):
            yield robot


def has_work_left(observer: Observer, robot: str, left_s: float, now_us: int) -> bool:
    """True if the robot's action continues for `left_s`, or if its duration is unknown."""
    work = time_at_work(observer, robot, now_us)
    return work is not None and (work.expected_s is None or work.expected_s - work.for_s >= left_s)


def next_to_kill(observer: Observer) -> str:
    """Return a robot to kill: a replaceable one at work, else one at work, else any; or empty."""
    living = sorted(observer.membership.members(), key=name_order)
    at_work = [robot for robot in living if observer.claim(robot) is not None]
    return next(iter([*replaceable(observer), *at_work, *living]), "")
