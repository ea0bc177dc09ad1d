"""Run whole missions in virtual time, with faults, to test them: see `simulate`.

`engine` is one run; `checkers` look on and hold it against the invariants; `run` puts both
together; `chaos` draws faults and missions, `statistics` counts over many runs, `parallel` spreads
them over processes. Users' own tests may import what is listed here.

It may import the runtime, whose action runner carries out users' programs, and what is below;
never Zenoh. The same seed gives the same run, to the byte.
"""

from mrbt_mesh.sim.run import SimulationError, SimulationResult, simulate
from mrbt_mesh.sim.world.faults import (
    Block,
    ChangePerformance,
    ClockJump,
    ClockRate,
    Command,
    Disk,
    Disturb,
    EndRouter,
    Fault,
    Freeze,
    Garbage,
    Heal,
    Kill,
    KillAfter,
    Leave,
    Lose,
    LoseToken,
    Replay,
    Restart,
    Restore,
    Schedule,
    Settle,
    Slow,
    StartRouter,
    Suspend,
    Thaw,
    Unblock,
    partition,
)
from mrbt_mesh.sim.world.network import LinkKnobs, NetworkKnobs
from mrbt_mesh.sim.world.setup import AgentOptions

__all__ = [
    "AgentOptions",
    "Block",
    "ChangePerformance",
    "ClockJump",
    "ClockRate",
    "Command",
    "Disk",
    "Disturb",
    "EndRouter",
    "Fault",
    "Freeze",
    "Garbage",
    "Heal",
    "Kill",
    "KillAfter",
    "Leave",
    "LinkKnobs",
    "Lose",
    "LoseToken",
    "NetworkKnobs",
    "Replay",
    "Restart",
    "Restore",
    "Schedule",
    "Settle",
    "SimulationError",
    "SimulationResult",
    "Slow",
    "StartRouter",
    "Suspend",
    "Thaw",
    "Unblock",
    "partition",
    "simulate",
]
