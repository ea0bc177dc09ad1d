"""Error responses of a server: problem details (RFC 9457)."""

from __future__ import annotations

import json
from collections.abc import Iterable
from http import HTTPStatus
from typing import Any

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Mount, Route

from mrbt_mesh.core.agent.operator_messages import (
    CONFLICT,
    CONTENDED,
    ENDED,
    FULL,
    OUT_OF_RANGE,
    UNKNOWN,
)
from mrbt_mesh.runtime.operator_call import NOT_HEARD, CommandRefusedError

STATUS_OF_CAUSE = {
    UNKNOWN: 404,
    CONFLICT: 409,
    CONTENDED: 409,
    ENDED: 409,
    OUT_OF_RANGE: 409,
    FULL: 503,
    NOT_HEARD: 503,
}
# With a 503: after how many seconds to retry.
RETRY = {"retry-after": "1"}


def problem(status: int, detail: str, headers: dict[str, str] | None = None) -> Response:
    """Return a response that tells what is wrong."""
    title = HTTPStatus(status).phrase
    data = {"type": "about:blank", "title": title, "status": status, "detail": detail}
    return Response(json.dumps(data), status, headers, "application/problem+json")


async def _of_http(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    status, headers = error.status_code, dict(error.headers or {})
    detail = error.detail
    if detail == HTTPStatus(status).phrase:  # the router's own words
        path = f"{request.scope['path']!r:.80}"
        if status == HTTPStatus.NOT_FOUND:
            known = ", ".join(paths(request.app.routes, request.scope.get("root_path", "")))
            detail = f"there is no {path}; there are {known}"
        elif status == HTTPStatus.METHOD_NOT_ALLOWED:
            detail = f"{path} takes no {request.method:.20}, but {headers.get('Allow', '')}"
    return problem(status, detail, headers)


def paths(routes: Iterable[BaseRoute], above: str = "") -> list[str]:
    """Return the paths of routes, including mounted ones."""
    found = []
    for route in routes:
        if isinstance(route, Mount):
            found += paths(route.routes, above + route.path)
        elif isinstance(route, Route):
            found.append(above + route.path)
    return found


async def _of_refusal(_: Request, error: Exception) -> Response:
    assert isinstance(error, CommandRefusedError)
    status = STATUS_OF_CAUSE.get(error.cause, 422)
    return problem(status, str(error), RETRY if status == 503 else None)


async def _of_timeout(_: Request, error: Exception) -> Response:
    return problem(504, str(error))


PROBLEMS: dict[Any, Any] = {
    HTTPException: _of_http,
    CommandRefusedError: _of_refusal,
    TimeoutError: _of_timeout,
}
