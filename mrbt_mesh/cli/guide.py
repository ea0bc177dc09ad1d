"""What `mrbt demo` adds to a run: it kills a robot itself, and names what to try next."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from shlex import quote

import anyio

from mrbt_mesh.cli.command_notes import note_command
from mrbt_mesh.core.facts.records import Phase
from mrbt_mesh.core.mission.mission import performance
from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.recording.folder import observer_file
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.team import Team
from mrbt_mesh.runtime.watcher import Watcher

LOOK_S = 0.2


class Guide:
    """Kills one robot at work, `kill_after_s` after the mission has begun."""

    def __init__(self, kill_after_s: float) -> None:
        self._kill_after_s = kill_after_s
        self._problems: list[str] = []

    @property
    def notes(self) -> tuple[str, ...]:
        """What to look at, to be shown with the team."""
        return (
            f"At {self._kill_after_s:g} s this demo kills a robot. Kill the next: mrbt kill B1, "
            "in another terminal",
        )

    async def kill_one(self, watcher: Watcher, team: Team) -> None:
        """Wait for a robot whose work another one can take over, and kill its process."""
        observer = watcher.observer
        while observer.record.result is None:
            await anyio.sleep(LOOK_S)
            passed_s = observer.record.seconds(boottime_us())
            if passed_s is None or passed_s < self._kill_after_s:
                continue
            for robot in replaceable(observer):
                process = team.process(robot)
                if process is not None:
                    os.kill(process.pid, signal.SIGKILL)
                    killed = f"{robot} (pid {process.pid}) killed"
                    # A view has the terminal: a warning waits for the closing words.
                    note_command(team.run_dir, "demo", killed, warn=self._problems.append)
                    return

    def closing(self, team: Team) -> list[str]:
        """Where the recording is, and three commands to try with it."""
        return [
            *self._problems,
            "",
            "The run is recorded. Try:",
            f"  mrbt recording replay {quote(str(observer_file(team.run_dir.path)))}",
            f"  mrbt recording verify {quote(str(team.run_dir.path))}",
            f"  mrbt recording report {quote(str(team.run_dir.path))}",
        ]


def replaceable(observer: Observer) -> Iterator[str]:
    """The robots at work that another one can replace now, and that no global task needs later."""
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
