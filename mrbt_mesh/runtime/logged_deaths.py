"""The times of deaths from the robots' own logs."""

from __future__ import annotations

import contextlib
import json
import time
from collections import defaultdict
from dataclasses import replace
from datetime import datetime

from mrbt_mesh.observer.episodes import DeathTimes, MajorFault
from mrbt_mesh.runtime.limited_file import NewLines
from mrbt_mesh.runtime.run_dir import RunDir

SUSPECTED, DEAD, BEGUN = EVENTS = "robot_suspect", "robot_dead", "local_task_started"
# The end of a process may be noticed here this much later than robots lost its token.
LATE_US = 1_000_000


class LoggedDeaths:
    """Follows the logs of a run's robots. Each line is read once, as the logs grow."""

    def __init__(self, run_dir: RunDir) -> None:
        self._run_dir = run_dir
        self._logs: dict[str, NewLines] = {}
        # Unix times in microseconds: (event, the robot that it is about), and of starts
        # (robot, activation, local task).
        self._about: defaultdict[tuple[str, str], list[int]] = defaultdict(list)
        self._starts: defaultdict[tuple[str, str, str], list[int]] = defaultdict(list)

    def look(self) -> None:
        """Read what was logged since the last call."""
        for path in self._run_dir.path.glob("*.log"):
            for line in self._logs.setdefault(path.stem, NewLines(path)).take():
                if any(event in line for event in EVENTS):
                    with contextlib.suppress(ValueError, KeyError, TypeError):  # damaged
                        self._take(path.stem, json.loads(line))

    def _take(self, robot: str, row: dict[str, str]) -> None:
        event = row["event"]
        at_us = round(datetime.fromisoformat(row["timestamp"]).timestamp() * 1e6)
        if event == BEGUN:
            self._starts[robot, row["activation"], row["local_task"]].append(at_us)
        elif event in EVENTS:
            self._about[event, row["robot"]].append(at_us)

    def times_of(self, fault: MajorFault, now_us: int) -> DeathTimes:
        """Return the logged times of a death; where nothing was logged, those of the fault.

        `now_us`: the current time on the fault's clock.
        """
        epoch_us, times, held = round(time.time() * 1e6) - now_us, fault.times, fault.held
        since_us = times.at_us - LATE_US * times.exact

        def since(found_us: list[int]) -> list[int]:
            return [us - epoch_us for us in found_us if us - epoch_us >= since_us]

        begun: list[int] = []
        if held is not None and times.replacement is not None:
            begun = self._starts[times.replacement, held.activation, held.local_task]
        suspected_us = since(self._about[SUSPECTED, fault.robot]) if times.exact else []
        return replace(
            times,
            at_us=min([times.at_us, *suspected_us]),
            detected_us=min(since(self._about[DEAD, fault.robot]), default=times.detected_us),
            reassigned_us=min(since(begun), default=times.reassigned_us),
        )
