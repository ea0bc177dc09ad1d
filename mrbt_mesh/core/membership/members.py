"""Whom a robot holds for alive, kept up to date robot by robot."""

from __future__ import annotations

import hashlib
from functools import lru_cache

from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.peer import Peer, set_member
from mrbt_mesh.core.membership.wire import DIGEST_BYTES

_MODULUS = 1 << 128


@lru_cache(maxsize=4_096)
def _hash(robot: str, incarnation: Incarnation) -> int:
    text = f"{robot} {incarnation}"
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=16).digest(), "big")


class Members:
    """`joined`: robot -> incarnation of those that a plan counts on, suspects included; `live`:
    those that are neither dead nor gone; `newcomers`: those in good standing that have yet to join.
    """

    def __init__(self) -> None:
        self.joined: dict[str, Incarnation] = {}
        self.live: set[str] = set()
        self.newcomers: set[str] = set()
        self._total = 0

    def note(self, robot: str, peer: Peer) -> None:
        """What is known of a robot has changed."""
        before = self.joined.pop(robot, None)
        if before is not None:
            self._total -= _hash(robot, before)
        has_joined, state = peer.report.has_joined, peer.state
        if has_joined and state.is_member:
            self.joined[robot] = peer.incarnation
            self._total += _hash(robot, peer.incarnation)
        set_member(self.live, robot, state.is_member)
        set_member(self.newcomers, robot, state.is_healthy and not has_joined)

    def digest(self, me: str, mine: Incarnation) -> bytes:
        """Over those that have joined and this robot: equal where they are."""
        total = (self._total + _hash(me, mine)) % _MODULUS
        return hashlib.blake2b(total.to_bytes(16, "big"), digest_size=DIGEST_BYTES).digest()
