"""A team's manifest: its members' public keys and roles, signed by the team's own key.

One JSON file, the same for everybody, and no secret. Every change makes a greater version, so that
a running team can take over a newer one and refuse an older one.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from mrbt_mesh.core.membership.keys import SIGNATURE_BYTES, Role
from mrbt_mesh.core.mission.names import is_robot_id
from mrbt_mesh.errors import InputError

PUBLIC_BYTES = 32
MAX_MEMBERS = 10_000


class ManifestError(InputError):
    """A manifest that cannot be used; the message says why."""


@dataclass(frozen=True)
class PublicKeys:
    """Those of one member: `sign` (Ed25519) and `agree` (X25519), 32 bytes each.

    `former`: keys that it signed with before. `is_revoked`: nothing it says counts any more, but
    what it had written stands.
    """

    role: Role
    sign: bytes
    agree: bytes
    former: tuple[bytes, ...] = ()
    is_revoked: bool = False


@dataclass(frozen=True)
class Manifest:
    """The members of a team by name. `authority`: the public key of whoever signs it."""

    version: int
    authority: bytes
    members: Mapping[str, PublicKeys] = field(default_factory=dict)
    signature: bytes = b""

    def signed(self, authority: Ed25519PrivateKey) -> Manifest:
        """The same with its signature."""
        signature = authority.sign(_content(self))
        return Manifest(self.version, self.authority, self.members, signature)

    def to_text(self) -> str:
        """As a file."""
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
    return {
        "version": manifest.version,
        "authority": manifest.authority.hex(),
        "members": members,
    }


def _content(manifest: Manifest) -> bytes:
    text = json.dumps(_plain(manifest), sort_keys=True, separators=(",", ":"))
    return b"mrbt manifest\0" + text.encode()


def parse_manifest(text: str, authority: bytes | None = None) -> Manifest:
    """A manifest from its file, its signature checked; raises ManifestError.

    `authority`: the key that must have signed it; None: the one that it names.
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
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise ManifestError(f"the manifest is malformed: {error}") from error
    if type(version) is not int or version < 1 or len(members) > MAX_MEMBERS:
        raise ManifestError("the manifest is malformed: its version is a number from 1 on")
    if authority is not None and found.authority != authority:
        raise ManifestError("the manifest is another team's: it names another team key")
    try:
        Ed25519PublicKey.from_public_bytes(found.authority).verify(found.signature, _content(found))
    except (InvalidSignature, ValueError):
        raise ManifestError(
            "the manifest was changed after it was signed: change it with `mrbt keys`"
        ) from None
    return found


def _member(name: str, row: Any) -> PublicKeys:
    if not is_robot_id(name):
        raise ValueError(f"{name[:32]!r} is no member's name")
    if type(row["revoked"]) is not bool:
        raise ValueError(f"{name}: revoked is true or false")
    return PublicKeys(
        Role(row["role"]),
        _bytes(row["sign"], PUBLIC_BYTES),
        _bytes(row["agree"], PUBLIC_BYTES),
        tuple(_bytes(key, PUBLIC_BYTES) for key in row["former"]),
        row["revoked"],
    )


def _bytes(text: str, size: int) -> bytes:
    data = bytes.fromhex(text)
    if len(data) != size:
        raise ValueError(f"{len(data)} bytes where a key or signature has {size}")
    return data
