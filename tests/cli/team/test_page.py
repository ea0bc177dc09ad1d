"""`mrbt web` says where the page is, for people and for programs."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from types import SimpleNamespace
from typing import Any

import pytest

from mrbt_mesh.cli.team import page
from mrbt_mesh.views.web.server import PageOptions

URL = "http://127.0.0.1:8000/"


@pytest.mark.parametrize("as_json", [False, True])
async def test_the_address_is_said(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], as_json: bool
) -> None:
    @asynccontextmanager
    async def opened(*_: object, **__: object) -> AsyncIterator[tuple[str, None]]:
        yield URL, None

    async def nothing(*_: object) -> None:
        pass

    for name, stub in {
        "watching": opened,
        "serving": opened,
        "follow": nothing,
        "until_stopped": nothing,
    }.items():
        monkeypatch.setattr(page, name, stub)
    address: Any = SimpleNamespace(run_dir=None)
    assert await page.serve(address, PageOptions(), None, as_json) == 0
    said = capsys.readouterr().out
    assert (json.loads(said) if as_json else said) == (
        {"page": URL} if as_json else f"page: {URL}\n"
    )
