"""The keys of a team's members: the manifest that lists them, and one member's keys.

The manifest has the public keys and roles of all members, signed by the team's own key: one JSON
file, the same for all, and no secret. Each change increases its version, so that a running team can
apply a newer one and refuse an older one.

A member has Ed25519 signatures, and tags by keys agreed with X25519. Both private keys are derived
from one secret of 32 bytes. The key for the tags of two members is agreed without a message: each
combines its own private key with the public key of the other.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey, X25519PublicKey

from mrbt_mesh.core.membership.keys import SIGNATURE_BYTES, TAG_BYTES, Role
from mrbt_mesh.core.mission.names import is_robot_id
from mrbt_mesh.errors import InputError

PUBLIC_BYTES = 32
MAX_MEMBERS = 10_000


class ManifestError(InputError):
    """A manifest cannot be used; the message has the reason."""


@dataclass(frozen=True)
class PublicKeys:
    """The public keys of one member: `sign` (Ed25519) and `agree` (X25519), 32 bytes each.

    `former`: keys that it signed with before. `is_revoked`: its messages are refused; facts that it
    wrote before remain valid.
    """

    role: Role
    sign: bytes
    agree: bytes
    former: tuple[bytes, ...] = ()
    is_revoked: bool = False


@dataclass(frozen=True)
class Manifest:
    """The members of a team by name. `authority` is the public key that verifies its signature."""

    version: int
    authority: bytes
    members: Mapping[str, PublicKeys] = field(default_factory=dict)
    signature: bytes = b""

    def signed(self, authority: Ed25519PrivateKey) -> Manifest:
        """Return a signed copy."""
        signature = authority.sign(_content(self))
        return Manifest(self.version, self.authority, self.members, signature)

    def to_text(self) -> str:
        """Return the content of the manifest's file."""
        data = _plain(self) | {"signature": self.signature.hex()}
        return json.dumps(data, indent=1, sort_keys=True) + "\n"


def _plain(manifest: Manifest) -> dict[str, Any]:
    members = {
        name: {
            "role": str(member.role),
            "sign": member.sign.hex(),
            "agree": member.agree.hex(),
            "former": [key.hex() for key in member.former],
            "revoked": member.is_revoked,
        }
        for name, member in manifest.members.items()
    }
    authority = manifest.authority.hex()
    return {"version": manifest.version, "authority": authority, "members": members}


def _content(manifest: Manifest) -> bytes:
    text = json.dumps(_plain(manifest), sort_keys=True, separators=(",", ":"))
    return b"mrbt manifest\0" + text.encode()


def parse_manifest(text: str, authority: bytes | None = None) -> Manifest:
    """Parse a manifest and check its signature. Raises ManifestError.

    `authority`: the key that must have signed it; None: the key that it names.
    """
    try:
        data = json.loads(text)
        members = {name: _member(name, row) for name, row in data["members"].items()}
        version = data["version"]
        found = Manifest(
            version,
            _bytes(data["authority"], PUBLIC_BYTES),
            members,
            _bytes(data["signature"], SIGNATURE_BYTES),
        )
    except (json.JSONDecodeError, RecursionError):
        raise _malformed("it is not JSON") from None
    except ValueError as error:
        raise _malformed(str(error)) from None
    except (TypeError, KeyError, AttributeError):
        raise _malformed("a field is missing or of another kind") from None
    if type(version) is not int or version < 1 or len(members) > MAX_MEMBERS:
        raise _malformed(f"its version is from 1 on, and it has at most {MAX_MEMBERS} members")
    if authority is not None and found.authority != authority:
        raise ManifestError("the manifest is another team's: it names another team key")
    try:
        Ed25519PublicKey.from_public_bytes(found.authority).verify(found.signature, _content(found))
    except (InvalidSignature, ValueError):
        raise ManifestError(
            "the manifest was changed after it was signed: change it with `mrbt keys`"
        ) from None
    if found.to_text() != text:
        raise ManifestError(
            "its text is not as `mrbt keys` writes it: copy the file as it is, with its line ends"
        )
    return found


def _malformed(why: str) -> ManifestError:
    remedy = "copy it again from the folder in which `mrbt keys` made it"
    return ManifestError(f"the manifest is malformed: {why}: {remedy}")


def _member(name: str, row: Any) -> PublicKeys:
    if not is_robot_id(name):
        raise ValueError(f"{name[:32]!r} is not a member's name")
    if type(row["revoked"]) is not bool:
        raise ValueError(f"{name}: revoked is true or false")
    if row["role"] not in list(Role):
        raise ValueError(f"{name}: {row['role']!r} is not a role")
    return PublicKeys(
        Role(row["role"]),
        _bytes(row["sign"], PUBLIC_BYTES),
        _bytes(row["agree"], PUBLIC_BYTES),
        tuple(_bytes(key, PUBLIC_BYTES) for key in row["former"]),
        row["revoked"],
    )


def _bytes(text: str, size: int) -> bytes:
    try:
        data = bytes.fromhex(text)
    except ValueError:
        raise ValueError("a key or signature is not hexadecimal") from None
    if len(data) != size:
        raise ValueError(f"{len(data)} bytes where a key or signature has {size}")
    return data


SECRET_BYTES = 32


def _derived(secret: bytes, purpose: bytes) -> bytes:
    return hashlib.blake2b(purpose, key=secret, digest_size=32).digest()


def _private_keys(secret: bytes) -> tuple[Ed25519PrivateKey, X25519PrivateKey]:
    return (
        Ed25519PrivateKey.from_private_bytes(_derived(secret, b"mrbt sign")),
        X25519PrivateKey.from_private_bytes(_derived(secret, b"mrbt agree")),
    )


def signing_key(secret: bytes) -> Ed25519PrivateKey:
    """Return the key that a secret signs with: a member's, or the team's."""
    return _private_keys(secret)[0]


def certifying_key(secret: bytes) -> Ed25519PrivateKey:
    """Return the key by which a team's secret signs certificates."""
    return Ed25519PrivateKey.from_private_bytes(_derived(secret, b"mrbt certify"))


def link_key(secret: bytes) -> Ed25519PrivateKey:
    """Return the key of a member's certificate."""
    return Ed25519PrivateKey.from_private_bytes(_derived(secret, b"mrbt link"))


def public_member(secret: bytes, role: Role) -> PublicKeys:
    """Return the manifest's entry for the holder of this secret."""
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
        """Use this manifest from now on."""
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
        """True if the manifest has revoked or replaced this member's key."""
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

    def was_signed(self, name: str, data: bytes, signature: bytes, role: Role = Role.ROBOT) -> bool:
        return was_signed(self.manifest, name, data, signature, role)

    def tag(self, name: str, data: bytes) -> bytes | None:
        key = self._shared.get(name)
        if key is None:
            member = self._members.get(name)
            if member is None:
                return None
            try:
                agreed = self._agree.exchange(X25519PublicKey.from_public_bytes(member.agree))
            except ValueError:
                return None  # a point of the curve that yields no secret
            key = self._shared[name] = _derived(agreed, b"mrbt tag")
        return hashlib.blake2b(data, key=key, digest_size=TAG_BYTES).digest()


def was_signed(
    manifest: Manifest, name: str, data: bytes, signature: bytes, role: Role = Role.ROBOT
) -> bool:
    """Return whether a member with this role signed this, with any present or former key.

    See `Keys.was_signed`.
    """
    member = manifest.members.get(name)
    if member is None or member.role is not role:
        return False
    return any(_verifies(key, data, signature) for key in (member.sign, *member.former))


def _verifies(public: bytes, data: bytes, signature: bytes) -> bool:
    try:
        Ed25519PublicKey.from_public_bytes(public).verify(signature, data)
    except (InvalidSignature, ValueError):
        return False
    return True
