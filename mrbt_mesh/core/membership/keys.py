"""Who is who in a team: members by name, what each may say, and what proves that one said it.

The core only asks; keys themselves, and the mathematics, are in the runtime.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from typing import Protocol

TAG_BYTES = 16
SIGNATURE_BYTES = 64


class Role(enum.StrEnum):
    """What a member may do: robots take part, operators read and command, observers read.

    Routers pass on what others say, and say nothing themselves.
    """

    ROBOT = "robot"
    OPERATOR = "operator"
    OBSERVER = "observer"
    ROUTER = "router"


class Keys(Protocol):
    """One member's private key, and the public ones of its team as it knows them now."""

    @property
    def name(self) -> str:
        """Whose private key this is."""

    def members(self) -> Sequence[str]:
        """All members in good standing that messages are for, sorted: routers are not."""

    def role_of(self, name: str) -> Role | None:
        """None for strangers, for routers and for members whose key has been revoked."""

    def sign(self, data: bytes) -> bytes:
        """`SIGNATURE_BYTES` that anybody can check who has the manifest."""

    def is_signed(self, name: str, data: bytes, signature: bytes) -> bool:
        """Whether a member in good standing signed this, with its present key."""

    def was_signed(self, name: str, data: bytes, signature: bytes) -> bool:
        """The same, also for members that have been revoked since, and for keys replaced since."""

    def tag(self, name: str, data: bytes) -> bytes | None:
        """`TAG_BYTES` that only this member and the one named can make; None for a stranger."""
