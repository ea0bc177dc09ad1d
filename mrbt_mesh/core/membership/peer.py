"""What one robot knows of another one."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.arrival_history import ArrivalHistory
from mrbt_mesh.core.membership.wire import Heartbeat, Position, SelfReport


class State(enum.StrEnum):
    """A robot as another one sees it. LEFT: gone on purpose.

    `is_healthy`: alive, not suspect. `is_member`: healthy or suspect, so neither dead nor gone.
    `is_suspected`: suspect or dead.
    """

    ALIVE = "alive"
    SUSPECT = "suspect"
    DEAD = "dead"
    LEFT = "left"

    # Read with every message; members of an enumeration are slow to look up.
    def __init__(self, name: str) -> None:
        self.is_healthy = name == "alive"
        self.is_member = name in ("alive", "suspect")
        self.is_suspected = name in ("suspect", "dead")


@dataclass(slots=True)
class Peer:
    """What is known of one robot's newest incarnation.

    `is_judged`: this robot listens for it, and suspects it when it is silent (`Membership.judged`).
    `position`: where it has said last that it is. `report`: its newest self-report, from its own
    heartbeat or relayed; it arrived at `last_heard_us`. After `probe_after_us` of silence the robot
    is suspected and probed, after `silence_limit_us` it is dead. `token_lost_by`: robots that lost
    its liveliness token, as this one did if `is_token_lost`. `declared_dead_by`: robots that hold
    it for dead.
    """

    incarnation: Incarnation
    report: SelfReport
    last_heard_us: int
    arrivals: ArrivalHistory
    silence_limit_us: int
    probe_after_us: int
    heartbeat: Heartbeat | None = None
    position: Position | None = None
    is_judged: bool = False
    is_probed: bool = False
    is_token_lost: bool = False
    state: State = State.ALIVE
    token_lost_by: set[str] = field(default_factory=set)
    declared_dead_by: set[str] = field(default_factory=set)


def set_member(names: set[str], name: str, is_member: bool) -> bool:
    """Have a name in a set, or not; whether that is new."""
    is_new = (name in names) is not is_member
    if is_new and is_member:
        names.add(name)
    elif is_new:
        names.discard(name)
    return is_new
