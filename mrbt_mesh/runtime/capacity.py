"""How many robots a machine can run, from the measured cost of a robot at rest.

The figures below were measured on two cores of a shared virtual machine (x86_64, Linux, Python
3.11): memory with 24 robots, processor time with 12 that all heard one another. In a ring, a robot
at rest takes half of it (docs/explanation/scale.md), but all robots have to start, which is where a
machine fails first. The work of robots' programs is extra; a slower machine runs fewer.
"""

from __future__ import annotations

import math
import os
import resource
from dataclasses import dataclass
from typing import Literal

import psutil

from mrbt_mesh.errors import InputError

# Processor time per robot and beat: its own beat, those that it receives, its links.
BEAT_COST_S = 0.009
# Additional memory per robot; memory shared by processes is counted once.
ROBOT_MEMORY_MB = 30
# The share of the processor for robots at rest: starting, planning and work need the rest.
MOST_OF_CORES = 0.6
MOST_OF_MEMORY = 0.8
# Open files and sockets per process of a team: 27 with 2 robots, 42 with 6, and at most two per
# further robot.
OPEN_FILES, OPEN_FILES_PER_ROBOT = 36, 2
# Beats of silence until a robot is declared dead, by default.
DETECTION_BEATS = 5


def allow_open_files(robots: int) -> None:
    """Raise this process's limit of open files, which robots inherit, to what such a team needs.

    Raises InputError if the system's limit is lower.
    """
    needed = OPEN_FILES + OPEN_FILES_PER_ROBOT * robots
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY or soft >= needed:
        return
    if hard != resource.RLIM_INFINITY and hard < needed:
        raise InputError(
            f"a process may open {hard} files here (ulimit -n), and each process of a team of "
            f"{robots} robots needs {needed}: raise the limit, or start fewer robots"
        )
    resource.setrlimit(resource.RLIMIT_NOFILE, (needed, hard))


@dataclass(frozen=True)
class Machine:
    """What robots share: the cores that this process may use, and the free memory in MB."""

    cores: int
    free_memory_mb: int

    @classmethod
    def here(cls) -> Machine:
        """Return the current state of this machine."""
        has_affinity = hasattr(os, "sched_getaffinity")
        cores = len(os.sched_getaffinity(0)) if has_affinity else os.cpu_count() or 1
        return cls(cores, psutil.virtual_memory().available // 1_000_000)


@dataclass(frozen=True)
class Overload:
    """More robots than a machine can run.

    It could run them with a beat of `enough_beat_s` and a detection time of `enough_detection_s`;
    None: its memory does not suffice.
    """

    robots: int
    carried: int
    limit: Literal["processor", "memory"]
    cores: int
    free_memory_mb: int
    beat_s: float
    enough_beat_s: float | None
    enough_detection_s: float | None


def overload(robots: int, beat_s: float, detection_s: float, machine: Machine) -> Overload | None:
    """Return the overload by this number of robots with these timings; None if there is none."""
    cores_s = machine.cores * MOST_OF_CORES
    by_processor = int(cores_s * beat_s / BEAT_COST_S)
    by_memory = int(machine.free_memory_mb * MOST_OF_MEMORY / ROBOT_MEMORY_MB)
    carried = max(1, min(by_processor, by_memory))
    if robots <= carried:
        return None
    enough_beat_s = enough_detection_s = None
    if robots <= by_memory:
        # Rounded up to tenths, but not for a binary fraction just above one.
        enough_beat_s = math.ceil(round(10 * robots * BEAT_COST_S / cores_s, 6)) / 10
        enough_detection_s = max(detection_s, round(DETECTION_BEATS * enough_beat_s, 1))
    limit: Literal["processor", "memory"] = "memory" if by_memory < by_processor else "processor"
    cores, memory = machine.cores, machine.free_memory_mb
    enough = enough_beat_s, enough_detection_s
    return Overload(robots, carried, limit, cores, memory, beat_s, *enough)
