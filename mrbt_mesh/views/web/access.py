"""Who may do what: a file of tokens, or protection against other pages on the same machine."""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import re
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

from pydantic import Field, model_validator
from starlette.exceptions import HTTPException
from starlette.requests import Request

from mrbt_mesh.formats.file_model import FileModel, Name, one_of, read_model
from mrbt_mesh.formats.yaml_source import read_mapping
from mrbt_mesh.runtime.team_client import user_name
from mrbt_mesh.views.web.protection import OwnNames, why_no_command

Role: TypeAlias = Literal["viewer", "operator"]
# (request, the role that it needs) -> the operator's name; raises HTTPException 401 or 403.
Access: TypeAlias = Callable[[Request, Role], str]

MIN_TOKEN = 16
_DIGEST = re.compile("[0-9a-f]{64}")
_Digest: TypeAlias = Annotated[
    str,
    one_of(
        "64 hexadecimal digits in lower case are expected",
        lambda value: isinstance(value, str) and _DIGEST.fullmatch(value) is not None,
    ),
]


_Secret: TypeAlias = Annotated[
    str,
    one_of(
        f"a text of at least {MIN_TOKEN} characters is expected",
        lambda value: isinstance(value, str) and len(value) >= MIN_TOKEN,
    ),
]


class _Token(FileModel):
    role: Role
    token: _Secret | None = None
    sha256: _Digest | None = None

    @model_validator(mode="after")
    def _has_one(self) -> _Token:
        if (self.token is None) is (self.sha256 is None):
            raise ValueError("give either token or sha256")
        return self

    def digest(self) -> str:
        return self.sha256 or hashlib.sha256((self.token or "").encode()).hexdigest()


class _TokensFile(FileModel):
    tokens: dict[Name, _Token] = Field(min_length=1)


def token_access(path: Path) -> Access:
    """Return access by the bearer tokens of a file. Raises FileError.

    tokens:
      anna: {role: operator, token: at-least-16-characters}
      wallboard: {role: viewer, sha256: 64 hexadecimal digits}
    """
    data, report = read_mapping(path, "tokens: ... is expected")
    model = read_model(_TokensFile, data, report)
    owners: dict[str, str] = {}
    for name, token in model.tokens.items():
        other = owners.setdefault(token.digest(), name)
        if other != name:
            report.add(("tokens", name), f"{other} has the same token; give each its own")
    report.raise_if_any()
    known = {name: (token.role, token.digest()) for name, token in model.tokens.items()}

    def access(request: Request, role: Role) -> str:
        scheme, _, given = request.headers.get("authorization", "").partition(" ")
        digest = hashlib.sha256(given.strip().encode()).hexdigest()
        matches = [name for name, (_, each) in known.items() if hmac.compare_digest(each, digest)]
        if scheme.lower() != "bearer" or not matches:
            text = "send a token of this server: the header `Authorization: Bearer TOKEN`"
            raise HTTPException(401, text, {"www-authenticate": "Bearer"})
        name = matches[0]
        if role == "operator" and known[name][0] != role:
            raise HTTPException(403, f"{name} is a viewer; this takes a token of an operator")
        return name

    return access


def local_access(own: OwnNames) -> Access:
    """Return access for all programs of this machine, but not for pages of other sites."""

    def access(request: Request, role: Role) -> str:
        if role == "operator" and why_no_command(request.headers, own) is not None:
            text = "web pages of other origins may command nothing here; programs send no header "
            text += "`Origin`, and behind a proxy the server is started with --public-url"
            raise HTTPException(403, text)
        return user_name()

    return access


def page_access(own: OwnNames, token: str | None) -> Access:
    """Return access for the live page: its `token` makes an operator; None: it only watches."""

    def access(request: Request, role: Role) -> str:
        if role == "operator":
            if token is None:
                raise HTTPException(403, "this page only watches: start it with --control")
            refusal = why_no_command(request.headers, own, token)
            if refusal is not None:
                raise HTTPException(403, refusal)
        return user_name()

    return access


def is_loopback(host: str) -> bool:
    """Return whether only this machine can reach what is served at an address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
