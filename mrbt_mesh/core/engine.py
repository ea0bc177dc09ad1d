"""How an agent or an observer makes plans and reads messages: one bundle, passed in.

Several agents in one process, as in the simulator, read the same messages and make the same plans:
they may share functions that remember their answers.
"""

from __future__ import annotations

from dataclasses import dataclass

from mrbt_mesh.core.membership.wire import (
    ReadBatch,
    ReadHeartbeat,
    WriteHeartbeat,
    read_batch,
    read_heartbeat,
    write_heartbeat,
)
from mrbt_mesh.core.planning.make_plan import PlanMaking, plain_plans, quick_plans


@dataclass(frozen=True)
class Engine:
    """What an agent or an observer computes with."""

    plan_making: PlanMaking = quick_plans
    write_heartbeat: WriteHeartbeat = write_heartbeat
    read_heartbeat: ReadHeartbeat = read_heartbeat
    read_batch: ReadBatch = read_batch


# What robots use.
FASTEST = Engine()
# Nothing is kept from one plan to the next.
DEFINITIONS = Engine(plain_plans)
