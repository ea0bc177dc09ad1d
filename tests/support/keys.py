"""Keys of a team in a test, the same ones in every run."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

from mrbt_mesh.core.membership.keys import Role
from mrbt_mesh.runtime.member_keys import Manifest, MemberKeys, public_member, signing_key


def secret_of(name: str) -> bytes:
    """A member's secret; anybody can work it out."""
    return hashlib.blake2b(name.encode(), digest_size=32).digest()


def manifest_of(roles: Mapping[str, Role], team: str = "team", version: int = 1) -> Manifest:
    """The signed manifest of these members; another `team` has other keys."""
    authority = signing_key(secret_of(f"the team {team}"))
    members = {name: public_member(secret_of(f"{team} {name}"), roles[name]) for name in roles}
    public = authority.public_key().public_bytes_raw()
    return Manifest(version, public, members).signed(authority)


def keys_of(
    *robots: str, operator: str = "op", observer: str = "", team: str = "team"
) -> dict[str, MemberKeys]:
    """The keys of every member of a team."""
    roles = dict.fromkeys(robots, Role.ROBOT)
    if operator:
        roles[operator] = Role.OPERATOR
    if observer:
        roles[observer] = Role.OBSERVER
    manifest = manifest_of(roles, team)
    return {name: MemberKeys(name, secret_of(f"{team} {name}"), manifest) for name in roles}
