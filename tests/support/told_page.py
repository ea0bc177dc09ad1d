"""The live page without a team: the test writes what a server would send."""

from __future__ import annotations

import json
import mimetypes
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote, urlsplit

from mrbt_mesh.views.model.mission_view import mission_view
from mrbt_mesh.views.web.app import STATIC
from tests.support.browser import WIDE, Problems
from tests.support.runs import example

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, Route

ADDRESS = "http://page.test/"


def told_mission(name: str) -> dict[str, Any]:
    """The description of a mission that the page loads at its start."""
    about = {"control": None, "recording": None, "commands": {}, "run": "r", "above": None}
    return mission_view(example(name)[0]) | about


def robot(place: str = "", **more: Any) -> dict[str, Any]:
    """A robot that is idle at a place."""
    said = {"state": "alive", "type": "cart", "capabilities": {}, "lost": {}, "pending": {}}
    work = {"local_task": None, "global_task": None, "phase": None, "under_way": "", "idle": ""}
    return said | work | {"place": place, "problems": [], "tree": [], "statuses": []} | more


def job(name: str, **more: Any) -> dict[str, Any]:
    """A job that waits, without a deadline."""
    what = {"id": name, "type": "inspect", "arguments": {"where": "shelf_1"}, "operator": "anna"}
    how = {"state": "waiting", "why": "", "priority": 0, "robots": [], "since_s": None}
    return what | how | {"deadline_us": 0, "deadline_s": None} | more


TEAM = {"ended": None, "ended_s": None, "command": "", "revision": 0, "pending": None}


def told_page(
    browser: Browser,
    mission: Mapping[str, Any],
    items: Mapping[str, Any],
    answers: Mapping[str, Any] | None = None,
    now_s: float = 100.0,
    size: tuple[int, int] = WIDE,
    scheme: Any = "light",
) -> tuple[Page, Problems]:
    """The page of a team whose state is `items` at `now_s`, where its time stays.

    `answers`: path -> what is answered there, such as `why/robot/C1`.
    """
    shown = {"team": TEAM, "headline": [{"level": "good", "text": "running"}], **items}
    message = json.dumps({"now_s": now_s, "run": mission["run"], "items": shown})
    # It is told once; the next time it asks it is told the same.
    stream = f"retry: 600000\nid: e.1\nevent: begin\ndata: {message}\n\n"

    def answer(route: Route) -> None:
        path = unquote(urlsplit(route.request.url).path[1:])
        if path == "events":
            route.fulfill(body=stream, content_type="text/event-stream")
        elif path == "mission":
            route.fulfill(json=dict(mission))
        elif path in (answers or {}):
            route.fulfill(json=(answers or {})[path])
        elif path == "" or path.startswith("static/"):
            file = STATIC / (path.removeprefix("static/") or "index.html")
            kind = mimetypes.guess_type(file)[0] or "text/plain"
            route.fulfill(body=file.read_bytes(), content_type=kind)
        else:
            route.fulfill(status=404)

    context = browser.new_context(
        viewport={"width": size[0], "height": size[1]}, color_scheme=scheme
    )
    page, problems = context.new_page(), Problems()
    page.on("pageerror", lambda error: problems.add(f"{error}\n{error.stack}"))
    page.route(f"{ADDRESS}**", answer)
    page.goto(ADDRESS)
    page.wait_for_selector('#headline p:has-text("running")')
    return page, problems
