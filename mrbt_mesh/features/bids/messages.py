"""What a robot asks its program about bids, and the answers."""

from __future__ import annotations

from dataclasses import dataclass

from mrbt_mesh.core.agent.effects import FeatureEffect
from mrbt_mesh.core.agent.inputs import FeatureInput
from mrbt_mesh.core.facts.store import Incarnation


@dataclass(frozen=True, slots=True)
class RequestBid(FeatureEffect):
    """Have the robot's program bid for a local task. Answered by BidsMade.

    `performance`: the robot's present performance of that task.
    """

    activation: str
    global_task: str
    local_task: str
    performance: int
    incarnation: Incarnation


@dataclass(frozen=True, slots=True)
class BidMade:
    """This robot's bid for a local task, in micro-units; None: it makes no bid.

    If its program failed, `reason` says why, and `error` is the traceback, for the log.
    """

    activation: str
    local_task: str
    performance: int | None
    error: str = ""
    reason: str = ""


@dataclass(frozen=True, slots=True)
class BidsMade(FeatureInput):
    """Answers to RequestBid, all that have arrived together."""

    bids: tuple[BidMade, ...]
