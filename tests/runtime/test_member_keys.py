"""One member's keys: signatures and tags that others can check, and what a manifest changes."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mrbt_mesh.core.membership.keys import SIGNATURE_BYTES, TAG_BYTES, Role
from mrbt_mesh.runtime.member_keys import Manifest, public_member
from tests.support.keys import keys_of, secret_of

KEYS = keys_of("A", "B", "C", observer="eye")


def test_a_signature_is_the_signers_alone() -> None:
    signature = KEYS["A"].sign(b"x")
    assert len(signature) == SIGNATURE_BYTES
    assert KEYS["B"].is_signed("A", b"x", signature)
    assert not KEYS["B"].is_signed("A", b"y", signature)
    assert not KEYS["B"].is_signed("C", b"x", signature)
    assert not KEYS["B"].is_signed("nobody", b"x", signature)
    assert not KEYS["B"].is_signed("A", b"x", b"")


def test_a_tag_is_that_of_two() -> None:
    tag = KEYS["A"].tag("B", b"x")
    assert tag is not None
    assert len(tag) == TAG_BYTES
    assert KEYS["B"].tag("A", b"x") == tag
    others = [KEYS["C"].tag("A", b"x"), KEYS["C"].tag("B", b"x"), KEYS["A"].tag("C", b"x")]
    assert tag not in [*others, KEYS["A"].tag("B", b"y"), KEYS["A"].tag("A", b"x")]
    assert KEYS["A"].tag("nobody", b"x") is None
    strangers = keys_of("A", "B", team="other")
    assert strangers["A"].tag("B", b"x") != tag


def test_a_public_key_that_gives_no_secret_gives_no_tag() -> None:
    keys = keys_of("A", "B")["A"]
    weak = replace(keys.manifest.members["B"], agree=bytes(32))
    keys.replace(replace(keys.manifest, members={**keys.manifest.members, "B": weak}))
    assert keys.tag("B", b"x") is None


def changed(keys: Manifest, **members: object) -> Manifest:
    return replace(keys, version=keys.version + 1, members={**keys.members, **members})  # type: ignore[dict-item]


def test_a_revoked_member_is_a_stranger_but_what_it_wrote_stands() -> None:
    keys = keys_of("A", "B")
    signature = keys["A"].sign(b"x")
    manifest = keys["B"].manifest
    gone = replace(manifest.members["A"], is_revoked=True)
    keys["B"].replace(changed(manifest, A=gone))
    assert keys["B"].role_of("A") is None
    assert list(keys["B"].members()) == ["B", "op"]
    assert not keys["B"].is_signed("A", b"x", signature)
    assert keys["B"].tag("A", b"x") is None
    assert keys["B"].was_signed("A", b"x", signature)


def test_a_replaced_key_signs_no_more_but_what_it_signed_stands() -> None:
    keys = keys_of("A", "B")
    signature = keys["A"].sign(b"x")
    manifest = keys["B"].manifest
    new = public_member(secret_of("new A"), Role.ROBOT)
    member = replace(new, former=(manifest.members["A"].sign,))
    keys["B"].replace(changed(manifest, A=member))
    assert not keys["B"].is_signed("A", b"x", signature)
    assert keys["B"].was_signed("A", b"x", signature)
    assert not keys["A"].is_outdated
    keys["A"].replace(keys["B"].manifest)
    assert keys["A"].is_outdated


@pytest.mark.parametrize("name", ["op", "eye", "nobody"])
def test_only_robots_write_facts(name: str) -> None:
    signature = KEYS[name].sign(b"x") if name in KEYS else bytes(64)
    assert not KEYS["A"].was_signed(name, b"x", signature)
