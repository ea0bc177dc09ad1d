"""The options of a robot: those of `mrbt agent`, of `join_team`, and of a whole run in run.json.

Importing it loads nothing else of the runtime.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from mrbt_mesh.runtime.settings import (
    DEFAULT_ALONE_AFTER_S,
    DEFAULT_BEAT_S,
    DEFAULT_DETECTION_S,
    DEFAULT_GATHER_S,
    DEFAULT_KEEP_MIB,
    MIB,
    WIRED,
)


@dataclass(frozen=True, kw_only=True)
class NetworkOptions:
    """Where a team is. Its robots, and the programs that watch it, use the same values.

    `team`, `run`: names, by default those of the mission. `listen`, `connect`, `routers`:
    endpoints; without any, robots discover each other on the interface `multicast`. `transport`:
    wired or wireless. `keys`: a folder made by `mrbt keys`; None: messages are not signed.
    """

    team: str | None = None
    run: str | None = None
    listen: Sequence[str] = ()
    connect: Sequence[str] = ()
    multicast: str | None = None
    routers: Sequence[str] = ()
    transport: str = WIRED
    keys: Path | None = None
    beat_s: float = DEFAULT_BEAT_S
    detection_s: float = DEFAULT_DETECTION_S


# Network options are always passed: their defaults may differ in the environment.
_OF_NETWORK = frozenset(each.name for each in fields(NetworkOptions))
# Options of `mrbt agent` whose name differs from the field's.
_NAMES = {
    "routers": "--router",
    "beat_s": "--beat",
    "detection_s": "--detection",
    "gather_s": "--join-timeout",
    "alone_after_s": "--alone-after",
    "keep_mib": "--keep",
}


@dataclass(frozen=True, kw_only=True)
class RobotOptions(NetworkOptions):
    """How a robot takes part in a team.

    `insecure`: it has no `keys`, and believes every sender. `type`: for a robot that the mission
    does not list. `program`, `solver`: None for the mission's. `expect`: robots that it waits for,
    for `gather_s` seconds if there is no team yet (None: all of the mission), and for
    `alone_after_s` while it hears none at all; `alone`: it waits for nobody. `run_dir`: folder for
    its journal, log and events, which let it come back after a crash. `takeover`: it replaces a
    live robot of the same id. `while_locked`: a file; it leaves once no process holds a lock on it.
    `record`: where it records its inputs and effects, with `record_beats` also each heartbeat.
    `keep_mib`: the size at which its log files are rotated and its recording ends.
    """

    insecure: bool = False
    type: str | None = None
    program: str | None = None
    solver: str | None = None
    expect: Sequence[str] | None = None
    gather_s: float = DEFAULT_GATHER_S
    alone_after_s: float = DEFAULT_ALONE_AFTER_S
    alone: bool = False
    run_dir: Path | None = None
    speed: float = 1.0
    takeover: bool = False
    exit_when_done: bool = False
    while_locked: Path | None = None
    record: Path | None = None
    record_beats: bool = False
    keep_mib: int = DEFAULT_KEEP_MIB
    metrics_port: int | None = None
    metrics_host: str = "127.0.0.1"

    @property
    def keep_bytes(self) -> int:
        """`keep_mib` in bytes."""
        return self.keep_mib * MIB

    def arguments(self) -> list[str]:
        """Return the command-line arguments of `mrbt agent` for these options."""
        words: list[str] = []
        for each in fields(self):
            value = getattr(self, each.name)
            is_default = value == each.default and each.name not in _OF_NETWORK
            if value is None or value is False or value == () or is_default:
                continue
            words.append(_NAMES.get(each.name, f"--{each.name.replace('_', '-')}"))
            if isinstance(value, tuple):
                words.append(",".join(value))
            elif value is not True:
                words.append(str(value))
        return words
