"""Which robots hear one another. Chosen once, by the number of robots in the mission:

- every robot hears every other one (`Dissemination`), or
- each hears its neighbours in a ring, and what concerns everybody is sent to everybody
  (`ring.RingDissemination`).

Membership and agents use only the interface of `Dissemination` and need not know the size of the
team. A small team uses nothing of `ring`: no groups, representatives, checks or digests of members,
no spacing of plans.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import NamedTuple, TypeAlias

from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.peer import Peer, State
from mrbt_mesh.core.membership.wire import DIGEST_BYTES, Heartbeat, SelfReport, Suspicion

# The healthy robots that judge a name: the name of a robot, or of a fact that some robots write for
# all.
Judges: TypeAlias = Callable[[str], Collection[str]]
# The robots that cannot continue before they know that others have a plan too.
Waiting: TypeAlias = Callable[[Judges], set[str]]


class Urgent(NamedTuple):
    """What others must hear at once when it changes.

    `is_agreed`: this robot represents its group, and the whole group reports this robot's plan.
    `broadcast`: the generation of what everybody has to hear.
    """

    digest: bytes
    result: int
    suspicions: tuple[Suspicion, ...]
    is_joined: bool
    is_leaving: bool
    request: tuple[str, str] | None
    answered: tuple[tuple[str, str], ...]
    broadcast: int
    is_agreed: bool


class Route(NamedTuple):
    """The robots that get a heartbeat (None: all), and the self-reports to relay besides."""

    to: tuple[str, ...] | None
    relays: Mapping[str, SelfReport]


EVERYBODY = Route(None, {})


class Dissemination:
    """Every robot hears every other one, and judges its silence.

    `peers`: a mapping that its owner changes. `now_us`: the time of the owner's last input.
    `broadcast_generation` grows when everybody has to hear from this robot at once. `newcomers`:
    healthy robots that have not joined yet, if others should wait for them because each changes the
    plan. `plan_spacing_us`: the least time between plans. `patience_us`: how much longer than its
    limit a robot may be silent, because this robot is in trouble itself. `learns_joins_from_facts`:
    joins are learnt from facts too, because not every robot hears every heartbeat.
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
        """Set the robots of a mission revision."""

    # -- the robots that this one judges ------------------------------------------------------

    @property
    def judged(self) -> Mapping[str, Peer]:
        """The members whose silence this robot judges."""
        return self._judged

    def judges(self, robot: str) -> bool:
        """True if this robot judges another one, or would judge it if it were alive."""
        return robot != self.me

    def witnesses(self, robot: str) -> list[str]:
        """The healthy robots that this one hears and that judge `robot` too."""
        judged = self._judged.items()
        return [name for name, peer in judged if peer.state.is_healthy and name != robot]

    def near(self) -> Mapping[str, Peer]:
        """The peers whose facts a joining robot needs."""
        return self._peers

    def note(self, robot: str, peer: Peer) -> None:
        """Note that a robot is new, has joined, or has changed its state."""
        peer.is_judged = peer.state.is_member
        if peer.is_judged:
            self._judged[robot] = peer
        else:
            self._judged.pop(robot, None)

    # -- what comes in ------------------------------------------------------------------------

    def heard(self, robot: str, heartbeat: Heartbeat, before: State | None) -> None:
        """Note that a robot's own heartbeat brought news. `before`: its state before, None if it is
        new.
        """

    def heard_outdated(self, robot: str, heartbeat: Heartbeat) -> None:
        """Note that a robot's own heartbeat was older than what is known of the robot."""

    def was_late(self) -> None:
        """Note that this robot itself was slow."""

    def check(self, robot: str) -> None:
        """Check a robot about which others disagree with this one on whether it is alive."""

    def is_given_up(self, robot: str, peer: Peer, accusers: int) -> bool:
        """True if a robot is dead because `accusers` others have declared it dead."""
        return False

    def declared_dead(self, robot: str, is_known: bool) -> None:
        """Note that this robot declared another one dead. `is_known`: others had done so before."""

    def expire(self) -> None:
        """End whatever lasts until now or earlier."""

    def ends_us(self) -> list[int]:
        """The times at which something has to `expire`."""
        return []

    # -- what goes out ------------------------------------------------------------------------

    def to_name(self, suspected: Mapping[str, Peer]) -> list[tuple[str, Peer]]:
        """The suspected or dead robots that a heartbeat names, sorted."""
        return sorted(suspected.items())

    def members_digest(self, mine: Incarnation) -> bytes:
        """A digest of the members, compared if not all hear all. `mine`: own incarnation."""
        return bytes(DIGEST_BYTES)

    def agrees(self, digest: bytes, reports: int) -> bool:
        """True if this robot represents a group that reports this plan as a whole.

        `reports` grows with each change of a reported plan.
        """
        return False

    def is_plan_only(self, urgent: Urgent, is_regular_due: bool) -> bool:
        """True if the next heartbeat only goes to robots that have to hear of a plan."""
        return False

    def route(
        self, urgent: Urgent, number: int, plan_only: bool, is_new: bool, waiting: Waiting | None
    ) -> Route:
        """Choose where heartbeat `number` goes. `is_new`: this robot is about to join.

        `waiting`: the robots that cannot continue before they know which robots have this plan.
        """
        return EVERYBODY
