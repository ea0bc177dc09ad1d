"""Bodies of requests: bounded, of the right media type; what is wrong with one, in plain words."""

from __future__ import annotations

import json
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request

from mrbt_mesh.errors import nearest
from mrbt_mesh.formats.json_text import without_doubles
from mrbt_mesh.formats.problems import found

JSON = "application/json"
MAX_BODY_BYTES = 65_536
MOST_PROBLEMS = 10
_Model = TypeVar("_Model", bound=BaseModel)
_EXPECTED = {
    "model_type": "an object",
    "dict_type": "an object",
    "string_type": "a text",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "greater_than_equal": "a whole number of at least {ge}",
}


async def json_body(request: Request, limit_bytes: int) -> bytes:
    """Return the body of a request, usually JSON; empty if it has none.

    Raises HTTPException: 413 if it is longer, 415 for another media type, 400 if it ends early.
    """
    body = b""
    try:
        async for chunk in request.stream():
            body += chunk
            if len(body) > limit_bytes:
                raise HTTPException(413, f"the body is longer than {limit_bytes} bytes")
    except ClientDisconnect:
        raise HTTPException(400, "the body is not complete") from None  # nobody reads this
    media_type = request.headers.get("content-type", "").partition(";")[0].strip()
    if body and media_type.lower() != JSON:
        text = f"a body is JSON: send the header `Content-Type: {JSON}`, not {media_type!r:.80}"
        raise HTTPException(415, text, {"accept": JSON})
    return body


async def read_body(request: Request, model: type[_Model]) -> _Model:
    """Return the body as a model; an empty body is an empty object.

    Raises as `json_body`, and 422.
    """
    body = await json_body(request, MAX_BODY_BYTES)
    _refuse_doubles(body)
    try:
        return model.model_validate_json(body or b"{}")
    except ValidationError as error:
        details = error.errors(include_url=False)[:MOST_PROBLEMS]
        raise HTTPException(422, "; ".join(_text(model, each) for each in details)) from None


def _refuse_doubles(body: bytes) -> None:
    """Raise HTTPException 422 for an object with a name twice, of which one would be ignored."""
    try:
        json.loads(body or b"{}", object_pairs_hook=without_doubles, parse_int=str)
    except (json.JSONDecodeError, UnicodeDecodeError, RecursionError):
        return  # said where it is read
    except ValueError as error:
        raise HTTPException(422, str(error)) from None


def _text(model: type[BaseModel], detail: ErrorDetails) -> str:
    """Return what is wrong, where, and what would be right."""
    kind, context = detail["type"], detail.get("ctx", {})
    place = ".".join(str(part)[:80] for part in detail["loc"]) or "the body"
    if kind == "json_invalid":
        return f"the body is not JSON: {context['error']}"
    if kind == "missing":
        return f"{place}: it is missing"
    if kind == "extra_forbidden":
        return f"{place}: there is no such field" + nearest(place, model.model_fields)
    if kind == "value_error":
        return f"{place}: {context['error']}"
    expected = _EXPECTED.get(kind, detail["msg"]).format(**context)
    return f"{place}: {expected} is expected, {sent(detail['input'])} was sent"


def sent(value: Any) -> str:
    """Return a short text for a JSON value of the wrong type."""
    if value is None:
        return "null"
    return "an object" if isinstance(value, dict) else found(value)
