"""Manifests: read back as written, refused when anything of them was changed."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest

from mrbt_mesh.core.membership.keys import Role
from mrbt_mesh.runtime.member_keys import ManifestError, parse_manifest
from tests.support.keys import manifest_of

MANIFEST = manifest_of({"A": Role.ROBOT, "op": Role.OPERATOR, "eye": Role.OBSERVER})


def test_a_manifest_is_read_back_as_it_was_written() -> None:
    assert parse_manifest(MANIFEST.to_text()) == MANIFEST
    assert parse_manifest(MANIFEST.to_text(), MANIFEST.authority) == MANIFEST


def changed(path: tuple[str, ...], value: Any) -> str:
    data = json.loads(MANIFEST.to_text())
    inner = data
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return json.dumps(data)


@pytest.mark.parametrize(
    ("path", "value", "problem"),
    [
        (("version",), 2, "changed after it was signed"),
        (("members", "eye", "role"), "operator", "changed after it was signed"),
        (("members", "eye", "revoked"), True, "changed after it was signed"),
        (("members", "A", "sign"), "00" * 32, "changed after it was signed"),
        (("members", "A", "former"), ["00" * 32], "changed after it was signed"),
        (("signature",), "00" * 64, "changed after it was signed"),
        (("signature",), "00", "malformed"),
        (("version",), "1", "malformed"),
        (("version",), 0, "malformed"),
        (("members", "A", "role"), "king", "malformed"),
        (("members", "A", "revoked"), 1, "malformed"),
        (("members", "A", "sign"), "x", "malformed"),
        (("members", "A"), {}, "malformed"),
        (("members", "not a name"), {}, "malformed"),
        (("members",), [], "malformed"),
    ],
)
def test_a_changed_manifest_is_refused(path: tuple[str, ...], value: Any, problem: str) -> None:
    with pytest.raises(ManifestError, match=problem):
        parse_manifest(changed(path, value))


@pytest.mark.parametrize("text", ["", "[]", "{}", "7", "\x00", "[" * 100_000])
def test_what_is_no_manifest_is_refused(text: str) -> None:
    with pytest.raises(ManifestError, match="malformed"):
        parse_manifest(text)


def test_a_manifest_signed_by_another_team_is_refused() -> None:
    other = manifest_of({"A": Role.ROBOT}, team="other")
    with pytest.raises(ManifestError, match="another team's"):
        parse_manifest(other.to_text(), MANIFEST.authority)
    forged = replace(other, authority=MANIFEST.authority)
    with pytest.raises(ManifestError, match="changed after it was signed"):
        parse_manifest(forged.to_text(), MANIFEST.authority)


def test_a_manifest_in_another_text_is_refused() -> None:
    text = MANIFEST.to_text()
    assert parse_manifest(text) == MANIFEST
    for other in (text.replace("\n", "\r\n"), text + "\n", json.dumps(json.loads(text))):
        with pytest.raises(ManifestError, match="its text is not as `mrbt keys` writes it"):
            parse_manifest(other)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "it is not JSON"),
        ("{}", "a field is missing or of another kind"),
        (changed(("members", "A", "sign"), "x"), "a key or signature is not hexadecimal"),
        (changed(("members", "A", "role"), "king"), "A: 'king' is not a role"),
    ],
)
def test_what_is_wrong_with_a_manifest_is_said_in_our_words(text: str, said: str) -> None:
    with pytest.raises(ManifestError) as refused:
        parse_manifest(text)
    remedy = "copy it again from the folder in which `mrbt keys` made it"
    assert str(refused.value) == f"the manifest is malformed: {said}: {remedy}"
