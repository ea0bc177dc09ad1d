"""What keeps other pages and other machines from reading or steering the team through a browser.

- Host: names other than those under which the page is served are refused, so a name that an
  attacker has resolve to this machine (DNS rebinding) leads nowhere.
- Commands: they carry a token in a header of its own, which a form cannot send and another page's
  script may not; and the browser's own word on where they come from must be this page.
- Content-Security-Policy: nothing but the page's own files is loaded or run.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
import re
import secrets
from collections.abc import Iterable
from dataclasses import dataclass
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from mrbt_mesh.views.web.problem import problem

TOKEN_HEADER = "x-mrbt-token"
_USUAL_PORTS = {"http": 80, "https": 443}
_INLINE = re.compile(rb"<script[^>]*>(.+?)</script>", re.DOTALL)


def new_token() -> str:
    """Return a token that cannot be guessed."""
    return secrets.token_urlsafe(24)


def policy(page: bytes) -> str:
    """Return the Content-Security-Policy of a page: its own files, and its import map."""
    digests = (hashlib.sha256(script).digest() for script in _INLINE.findall(page))
    hashes = "".join(f" 'sha256-{base64.b64encode(each).decode()}'" for each in digests)
    return (
        f"default-src 'none'; script-src 'self'{hashes}; style-src 'self'; img-src 'self'; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )


@dataclass(frozen=True)
class OwnNames:
    """The names by which a server is reached.

    The Host headers that name it, the origins of its pages, and the prefix that a proxy removes
    from its paths (`/depot`, usually empty).
    """

    hosts: frozenset[str]
    origins: frozenset[str]
    prefix: str = ""


def own_names(names: Iterable[str], port: int, public_url: str = "") -> OwnNames:
    """Return the names of a server at these addresses and this port, behind a proxy at
    `public_url`.
    """
    hosts = {_host("http", name, port) for name in names}
    origins = {f"http://{host}" for host in hosts}
    public = urlsplit(public_url)
    if public.hostname is not None:
        named = _host(public.scheme, public.hostname, public.port)
        origins.add(f"{public.scheme}://{named}")
        # Proxies pass the name on with or without its port.
        hosts |= {named, _host(public.scheme, public.hostname, None)}
    return OwnNames(frozenset(hosts), frozenset(origins), public.path)


def _host(scheme: str, name: str, port: int | None) -> str:
    """Return a Host header as browsers write it: IPv6 in brackets, without a default port."""
    name = f"[{name}]" if ":" in name else name.lower()
    return name if port in (None, _USUAL_PORTS[scheme]) else f"{name}:{port}"


def why_no_command(headers: Headers, own: OwnNames, token: str | None = None) -> str | None:
    """Return why a request may not control what the page shows, or None if it may.

    `token`: what it must carry; None: it needs none, because it controls no team.
    """
    if headers.get("sec-fetch-site", "same-origin") != "same-origin":
        return "commands are taken from this page alone"
    origin = headers.get("origin")
    if origin is not None and origin not in own.origins:
        return "commands are taken from this page alone"
    if token is not None and not hmac.compare_digest(
        headers.get(TOKEN_HEADER, "").encode(), token.encode()
    ):
        return "the token is missing or wrong: open the address that was printed"
    return None


class Protection:
    """ASGI middleware that refuses foreign hosts, and adds headers to every answer.

    `own` None: any host is accepted, for a server that requires tokens, which pages of other sites
    lack.
    """

    def __init__(self, app: ASGIApp, own: OwnNames | None, content_policy: str) -> None:
        self._app = app
        self._hosts = own.hosts if own is not None else None
        self._headers = {
            "content-security-policy": content_policy,
            "cross-origin-opener-policy": "same-origin",
            "cross-origin-resource-policy": "same-origin",
            "referrer-policy": "no-referrer",
            "x-content-type-options": "nosniff",
            "cache-control": "no-cache",
        }

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return await self._app(scope, receive, send)

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in self._headers.items():
                    headers[name] = value
            await send(message)

        headers = Headers(scope=scope)
        if self._hosts is None:
            return await self._app(scope, receive, send_with_headers)
        if headers.get("host", "").lower() not in self._hosts:
            text = "this server has another name; behind a proxy give that one with --public-url"
            refusal = problem(421, text)
            return await refusal(scope, receive, send_with_headers)
        # Other sites may link to the page, but read nothing from it.
        is_foreign = headers.get("sec-fetch-site", "none") not in ("none", "same-origin")
        if is_foreign and scope["path"] != "/":
            refusal = problem(403, "pages of other sites may not read this")
            return await refusal(scope, receive, send_with_headers)
        return await self._app(scope, receive, send_with_headers)
