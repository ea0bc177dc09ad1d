"""Tokens and their roles, and the file that they are in."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest
from starlette.exceptions import HTTPException
from starlette.requests import Request

from mrbt_mesh.errors import FileError
from mrbt_mesh.views.web.access import Role, is_loopback, local_access, token_access
from mrbt_mesh.views.web.protection import own_names

SECRET, OTHER = "a-secret-of-anna-0001", "a-secret-of-bert-0002"
FILE = f"""
tokens:
  anna: {{role: operator, token: {SECRET}}}
  board: {{role: viewer, sha256: {hashlib.sha256(OTHER.encode()).hexdigest()}}}
"""


def asked(**headers: str) -> Request:
    raw = [(name.replace("_", "-").encode(), value.encode()) for name, value in headers.items()]
    return Request({"type": "http", "headers": raw})


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "tokens.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("authorization", "role", "found"),
    [
        (f"Bearer {SECRET}", "operator", "anna"),
        (f"bearer {SECRET}", "viewer", "anna"),
        (f"Bearer {OTHER}", "viewer", "board"),
        (f"Bearer {OTHER}", "operator", 403),
        (f"Bearer {SECRET}x", "viewer", 401),
        (f"Basic {SECRET}", "viewer", 401),
        ("Bearer", "viewer", 401),
        ("", "viewer", 401),
    ],
)
def test_a_token_gives_its_name_and_its_role(
    tmp_path: Path, authorization: str, role: Role, found: str | int
) -> None:
    access = token_access(written(tmp_path, FILE))
    request = asked(authorization=authorization) if authorization else asked()
    if isinstance(found, str):
        assert access(request, role) == found
    else:
        with pytest.raises(HTTPException) as refused:
            access(request, role)
        assert refused.value.status_code == found


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[]", "tokens: ... is expected"),
        ("tokens: {}", "tokens"),
        ("tokens: {anna: {role: boss, token: 0123456789abcdef}}", ":1: tokens/anna/role: "),
        (
            "tokens: {anna: {role: viewer, token: short}}",
            ":1: tokens/anna/token: a text of at least 16 characters is expected, found the text",
        ),
        (
            f"tokens: {{anna: {{role: viewer, token: {SECRET}}}, "
            f"bert: {{role: operator, sha256: {hashlib.sha256(SECRET.encode()).hexdigest()}}}}}",
            ":1: tokens/bert: anna has the same token; give each its own",
        ),
        ("tokens: {anna: {role: viewer}}", "give either token or sha256"),
        ("tokens: {anna: {role: viewer, sha256: beef}}", ":1: tokens/anna/sha256: "),
    ],
)
def test_a_wrong_file_is_refused_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(FileError) as refused:
        token_access(written(tmp_path, text))
    assert message in str(refused.value)


def test_without_tokens_pages_of_other_sites_submit_nothing() -> None:
    access = local_access(own_names(["127.0.0.1"], 8000, "https://robots.example:8443/depot"))
    for origin in ("http://127.0.0.1:8000", "https://robots.example:8443"):
        assert access(asked(origin=origin), "operator")
    assert access(asked(), "operator")
    for origin in ("http://evil.example", "http://robots.example:8443", "https://robots.example"):
        with pytest.raises(HTTPException) as refused:
            access(asked(origin=origin), "operator")
        assert refused.value.status_code == 403
        assert "web pages of other origins may command nothing here" in refused.value.detail


@pytest.mark.parametrize(
    ("public_url", "hosts", "origins"),
    [
        ("", set(), set()),
        ("https://robots.example", {"robots.example"}, {"https://robots.example"}),
        ("https://Robots.example:443/a", {"robots.example"}, {"https://robots.example"}),
        (
            "http://[::2]:81",
            {"[::2]", "[::2]:81"},
            {"http://[::2]:81"},
        ),
    ],
)
def test_under_which_names_a_server_is_reached(
    public_url: str, hosts: set[str], origins: set[str]
) -> None:
    found = own_names(["127.0.0.1", "::1"], 80, public_url)
    assert found.hosts == {"127.0.0.1", "[::1]", *hosts}, "port 80 goes without saying"
    assert found.origins == {"http://127.0.0.1", "http://[::1]", *origins}


@pytest.mark.parametrize(
    ("host", "is_local"),
    [("127.0.0.1", True), ("::1", True), ("localhost", True), ("0.0.0.0", False), ("a.b", False)],
)
def test_which_addresses_are_for_this_machine_alone(host: str, is_local: bool) -> None:
    assert is_loopback(host) is is_local
