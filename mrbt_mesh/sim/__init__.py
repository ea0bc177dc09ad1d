"""Run whole missions in virtual time, with faults, to test them: see `simulate`.

`world` is the simulated team and its network, `checkers` check the invariants during a run, `run`
joins both; `chaos` draws missions and faults, `estimate` counts over many runs, `parallel` spreads
them over processes. The names that are imported here are for users' own tests.

The simulator runs users' programs with the runtime's action runner, and never imports Zenoh. The
same seed gives the same run, to the byte.
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
    Pause,
    Replay,
    Restart,
    Restore,
    Schedule,
    Settle,
    SetWallClock,
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
    "Pause",
    "Replay",
    "Restart",
    "Restore",
    "Schedule",
    "SetWallClock",
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
