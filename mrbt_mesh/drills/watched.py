"""Carries out the steps of drill files on the team that is being watched.

`mrbt drill` starts a separate team and judges it; this team is not judged.
"""

from __future__ import annotations

from typing import Any

import anyio
import anyio.abc
import psutil

from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.drills.drill_file import Drill, drill_files, drill_folder, load_drills
from mrbt_mesh.drills.inject import DrillInjector, InjectedFault
from mrbt_mesh.drills.triggers import Schedule
from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.team import Team
from mrbt_mesh.runtime.watcher import Watcher

LOOK_S = 0.05
# Errors of a single fault; the team and its observers continue.
REFUSALS = (InputError, OSError, psutil.Error)


def fitting_drills(mission: Mission) -> dict[str, Drill]:
    """Return label -> drill, for the drills of this mission that need only processes."""
    found = [drill for path in drill_files(drill_folder()) for drill in load_drills(path)]
    return {
        drill.label: drill
        for drill in found
        if drill.mission.digest == mission.digest
        and drill.model.network == "loopback"
        and not drill.model.routers
    }


class TeamDrills:
    """Runs one drill at a time on a team of this machine."""

    def __init__(self, watcher: Watcher, team: Team, group: anyio.abc.TaskGroup) -> None:
        self._watcher = watcher
        self._team = team
        self._group = group
        self._known: dict[str, Drill] | None = None
        self._running: str | None = None

    async def _drills(self) -> dict[str, Drill]:
        if self._known is None:
            mission = self._watcher.observer.mission
            self._known = await anyio.to_thread.run_sync(fitting_drills, mission)
        return self._known

    async def known(self) -> list[dict[str, Any]]:
        """Return label, file, description and steps of each drill that fits the team.

        Raises InputError if a drill file is wrong.
        """
        return [
            {
                "label": drill.label,
                "file": drill.path.name,
                "description": " ".join(drill.model.description.split()),
                "steps": [step.text() for step in drill.steps],
            }
            for drill in (await self._drills()).values()
        ]

    async def start(self, label: str) -> str:
        """Start a drill. Raises InputError if there is no such drill, or another one runs."""
        drill = (await self._drills()).get(label)
        if drill is None:
            raise InputError(f"no drill {label[:80]!r} fits this mission")
        if self._running is not None:
            raise InputError(f"the drill {self._running} runs")
        self._running = label
        self._group.start_soon(self._run, drill)
        return f"{label}: {len(drill.steps)} steps, each at its moment"

    async def _run(self, drill: Drill) -> None:
        record, watcher = self._watcher.observer.record, self._watcher
        injector = DrillInjector(self._team, watcher, None, None, self._tell)
        schedule = Schedule(drill.steps)
        problem = ""
        try:
            while not schedule.is_over and record.result is None:
                if not await injector.carry_out_due(schedule, schedule.look(watcher.observer)):
                    await anyio.sleep(LOOK_S)
        except REFUSALS as error:
            problem = str(error)
        finally:
            self._running = None
        problem = problem or "; ".join(injector.injected.problems)
        left = len(drill.steps) - schedule.next
        end = problem or (f"ended with {left} steps left" if left else "all steps carried out")
        record.say(boottime_us(), f"drill {drill.label}: {end}")

    def _tell(self, fault: InjectedFault) -> None:
        text = f"drill: {' '.join(fault.robots)} {fault.text}".replace(":  ", ": ")
        self._watcher.observer.record.say(fault.at_us, text)
