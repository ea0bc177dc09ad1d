"""Which robots hear one another. The number of robots in the mission decides it once:

- every robot hears every other one (`Dissemination`), or
- each hears its neighbours in a ring, and what concerns everybody goes to everybody
  (`ring.RingDissemination`).

Membership and agents use only `Dissemination`, and do not ask how large a team is. A small team
uses nothing of `ring`: no groups, representatives, checks or digests of members, no spacing of
plans.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import NamedTuple, TypeAlias

from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.peer import Peer, State
from mrbt_mesh.core.membership.wire import DIGEST_BYTES, Heartbeat, SelfReport, Suspicion

# The healthy robots that judge a name: that of a robot, or of a fact that some robots write for
# all.
Judges: TypeAlias = Callable[[str], Collection[str]]
# The robots that cannot go on before they know that others have a plan too.
Waiting: TypeAlias = Callable[[Judges], set[str]]


class Urgent(NamedTuple):
    """What others must hear at once when it changes.

    `is_agreed`: this robot represents its group, all of which report its plan. `broadcast`: the
    generation of what everybody has to hear.
    """

    digest: bytes
    result: int
    suspicions: tuple[Suspicion, ...]
    is_joined: bool
    is_leaving: bool
    sought: tuple[str, str] | None
    granted: tuple[tuple[str, str], ...]
    broadcast: int
    is_agreed: bool


class Route(NamedTuple):
    """The robots that get a heartbeat (None: all), and the self-reports to relay besides."""

    to: tuple[str, ...] | None
    relays: Mapping[str, SelfReport]


EVERYBODY = Route(None, {})


class Dissemination:
    """Every robot hears every other one, and judges its silence.

    `peers` is a mapping that its owner changes; `now_us` is the time of the owner's last input.
    `broadcast_generation` grows when everybody has to hear from this robot at once. `newcomers`:
    healthy robots that have yet to join, if others should wait for them: each changes the plan.
    Plans come no closer than `plan_spacing_us`. `patience_us`: how much longer than its limit a
    robot may be silent, since this one has trouble itself. `learns_joins_from_facts`: and not from
    heartbeats, which not all robots hear.
    """

    learns_joins_from_facts = False

    def __init__(self, me: str, peers: Mapping[str, Peer]) -> None:
        self.me = me
        self.now_us = 0
        self.broadcast_generation = 0
        self.newcomers: set[str] = set()
        self.plan_spacing_us = 0
        self.patience_us = 0
        self._peers = peers
        self._judged: dict[str, Peer] = {}

    def set_team(self, team: Collection[str]) -> None:
        """The robots of a revision of the mission."""

    # -- the robots that this one judges ------------------------------------------------------

    @property
    def judged(self) -> Mapping[str, Peer]:
        """The members whose silence this robot judges."""
        return self._judged

    def judges(self, robot: str) -> bool:
        """Whether this robot judges another one, or would if that were alive."""
        return robot != self.me

    def witnesses(self, robot: str) -> list[str]:
        """The healthy robots that this one hears and that judge another one, as it does."""
        judged = self._judged.items()
        return [name for name, peer in judged if peer.state.is_healthy and name != robot]

    def near(self) -> Mapping[str, Peer]:
        """The peers whose facts a robot that joins needs to have."""
        return self._peers

    def note(self, robot: str, peer: Peer) -> None:
        """A robot is new, has joined, or is in another state than before."""
        peer.is_judged = peer.state.is_member
        if peer.is_judged:
            self._judged[robot] = peer
        else:
            self._judged.pop(robot, None)

    # -- what comes in ------------------------------------------------------------------------

    def heard(self, robot: str, heartbeat: Heartbeat, before: State | None) -> None:
        """A robot's own heartbeat has brought news; `before`: its state, None: it is new."""

    def heard_outdated(self, robot: str, heartbeat: Heartbeat) -> None:
        """A robot's own heartbeat was older than what is known of it."""

    def was_late(self) -> None:
        """This robot itself was slow."""

    def check(self, robot: str) -> None:
        """Others hold a robot for alive, or dead, of which this one knows otherwise."""

    def is_given_up(self, robot: str, peer: Peer, accusers: int) -> bool:
        """Whether a robot is dead because `accusers` others have declared it dead."""
        return False

    def declared_dead(self, robot: str, is_known: bool) -> None:
        """This robot has declared one dead that it judges; `is_known`: another one did before."""

    def expire(self) -> None:
        """End what was meant to last until now."""

    def ends_us(self) -> list[int]:
        """When something has to `expire`."""
        return []

    # -- what goes out ------------------------------------------------------------------------

    def to_name(self, suspected: Mapping[str, Peer]) -> list[tuple[str, Peer]]:
        """The suspects that a heartbeat names, sorted."""
        return sorted(suspected.items())

    def members_digest(self, mine: Incarnation) -> bytes:
        """A digest of the members, which robots compare if not all hear all; `mine`: one's own."""
        return bytes(DIGEST_BYTES)

    def agrees(self, digest: bytes, reports: int) -> bool:
        """Whether this robot represents a group, all of which report this plan.

        `reports` grows with each change of what is reported.
        """
        return False

    def is_plan_only(self, urgent: Urgent, is_regular_due: bool) -> bool:
        """Whether the next heartbeat only goes to robots that have to hear of a plan."""
        return False

    def route(
        self, urgent: Urgent, number: int, plan_only: bool, is_new: bool, waiting: Waiting | None
    ) -> Route:
        """Where heartbeat `number` goes. `is_new`: this robot is about to join in a new life.

        `waiting`: the robots that cannot go on before they know which robots have this plan.
        """
        return EVERYBODY
