"""One member's keys at work: Ed25519 signatures, and tags by keys agreed with X25519.

Both private keys come from one secret of 32 bytes. The key for the tags of two members is agreed
without a message: each combines its own private key with the other's public one.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey, X25519PublicKey

from mrbt_mesh.core.membership.keys import TAG_BYTES, Role
from mrbt_mesh.runtime.manifest import Manifest, PublicKeys

SECRET_BYTES = 32


def _derived(secret: bytes, purpose: bytes) -> bytes:
    return hashlib.blake2b(purpose, key=secret, digest_size=32).digest()


def _private_keys(secret: bytes) -> tuple[Ed25519PrivateKey, X25519PrivateKey]:
    return (
        Ed25519PrivateKey.from_private_bytes(_derived(secret, b"mrbt sign")),
        X25519PrivateKey.from_private_bytes(_derived(secret, b"mrbt agree")),
    )


def signing_key(secret: bytes) -> Ed25519PrivateKey:
    """The key that a secret signs with: a member's, or the team's."""
    return _private_keys(secret)[0]


def certifying_key(secret: bytes) -> Ed25519PrivateKey:
    """The key by which a team's secret signs certificates."""
    return Ed25519PrivateKey.from_private_bytes(_derived(secret, b"mrbt certify"))


def link_key(secret: bytes) -> Ed25519PrivateKey:
    """The key of a member's certificate."""
    return Ed25519PrivateKey.from_private_bytes(_derived(secret, b"mrbt link"))


def public_member(secret: bytes, role: Role) -> PublicKeys:
    """What the manifest says of whoever holds this secret."""
    sign, agree = _private_keys(secret)
    return PublicKeys(
        role, sign.public_key().public_bytes_raw(), agree.public_key().public_bytes_raw()
    )


class MemberKeys:
    """Implements `core.membership.keys.Keys` for one member and a manifest that may be replaced."""

    def __init__(self, name: str, secret: bytes, manifest: Manifest) -> None:
        self._name = name
        self._sign, self._agree = _private_keys(secret)
        self.replace(manifest)

    def replace(self, manifest: Manifest) -> None:
        """Go by this manifest from now on."""
        self.manifest = manifest
        self._members = {
            name: member
            for name, member in manifest.members.items()
            if not member.is_revoked and member.role is not Role.ROUTER
        }
        self._names = tuple(sorted(self._members))
        self._shared: dict[str, bytes] = {}

    @property
    def name(self) -> str:
        return self._name

    @property
    def is_outdated(self) -> bool:
        """Whether the manifest has revoked this very key, or put another one in its place."""
        member = self._members.get(self._name)
        return member is None or member.sign != self._sign.public_key().public_bytes_raw()

    def members(self) -> Sequence[str]:
        return self._names

    def role_of(self, name: str) -> Role | None:
        member = self._members.get(name)
        return member.role if member is not None else None

    def sign(self, data: bytes) -> bytes:
        return self._sign.sign(data)

    def is_signed(self, name: str, data: bytes, signature: bytes) -> bool:
        member = self._members.get(name)
        return member is not None and _verifies(member.sign, data, signature)

    def was_signed(self, name: str, data: bytes, signature: bytes) -> bool:
        return was_signed(self.manifest, name, data, signature)

    def tag(self, name: str, data: bytes) -> bytes | None:
        key = self._shared.get(name)
        if key is None:
            member = self._members.get(name)
            if member is None:
                return None
            try:
                agreed = self._agree.exchange(X25519PublicKey.from_public_bytes(member.agree))
            except ValueError:
                return None  # no point of the curve that a secret could come of
            key = self._shared[name] = _derived(agreed, b"mrbt tag")
        return hashlib.blake2b(data, key=key, digest_size=TAG_BYTES).digest()


def was_signed(manifest: Manifest, name: str, data: bytes, signature: bytes) -> bool:
    """Whether a robot signed this, with any key that it has or had: see `Keys.was_signed`."""
    member = manifest.members.get(name)
    if member is None or member.role is not Role.ROBOT:
        return False
    return any(_verifies(key, data, signature) for key in (member.sign, *member.former))


def _verifies(public: bytes, data: bytes, signature: bytes) -> bool:
    try:
        Ed25519PublicKey.from_public_bytes(public).verify(signature, data)
    except (InvalidSignature, ValueError):
        return False
    return True
