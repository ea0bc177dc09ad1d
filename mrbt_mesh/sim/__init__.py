"""Run whole missions in virtual time, with faults, to test them: see `simulate`."""

from mrbt_mesh.sim.faults import (
    Block,
    Command,
    Fault,
    Freeze,
    Garbage,
    Kill,
    Leave,
    Lose,
    LoseToken,
    Restart,
    Restore,
    Schedule,
    Thaw,
    Unblock,
    partition,
)
from mrbt_mesh.sim.network import LinkKnobs, NetworkKnobs
from mrbt_mesh.sim.run import SimulationError, SimulationResult, simulate

__all__ = [
    "Block",
    "Command",
    "Fault",
    "Freeze",
    "Garbage",
    "Kill",
    "Leave",
    "LinkKnobs",
    "Lose",
    "LoseToken",
    "NetworkKnobs",
    "Restart",
    "Restore",
    "Schedule",
    "SimulationError",
    "SimulationResult",
    "Thaw",
    "Unblock",
    "partition",
    "simulate",
]
