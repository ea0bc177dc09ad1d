"""What a server answers when something is wrong: problem details (RFC 9457)."""

from __future__ import annotations

import json
from http import HTTPStatus
from typing import Any

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response

from mrbt_mesh.core.agent.operator_desk import CONFLICT, CONTENDED, ENDED, FULL, UNKNOWN
from mrbt_mesh.runtime.operator_call import CommandRefusedError

STATUS_OF_CAUSE = {UNKNOWN: 404, CONFLICT: 409, CONTENDED: 409, ENDED: 409, FULL: 503}
# With a 503: after how many seconds to ask again.
RETRY = {"retry-after": "1"}


def problem(status: int, detail: str, headers: dict[str, str] | None = None) -> Response:
    """An answer that says what is wrong."""
    data = {"title": HTTPStatus(status).phrase, "status": status, "detail": detail}
    return Response(json.dumps(data), status, headers, "application/problem+json")


async def _of_http(_: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return problem(error.status_code, error.detail, dict(error.headers or {}))


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
