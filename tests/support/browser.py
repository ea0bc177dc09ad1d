"""Headless Chromium, and what it says of a page."""

from __future__ import annotations

import logging
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.support.paths import ROOT
from tests.support.team import TEST_TIMEOUT_S, Team

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

# Of every test with a browser.
MARKS = [
    pytest.mark.browser,
    pytest.mark.processes,
    pytest.mark.timeout(TEST_TIMEOUT_S),
    # Chromium's driver opens an event loop of its own.
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]
# The live page has received the state of the run.
CONNECTED = '#headline p:not(:has-text("connecting")):not(:has-text("waiting"))'
NAMES = ("chromium", "chromium-browser", "google-chrome")
MISSING = f"no {' or '.join(NAMES)} on PATH: `make test-browser` installs Debian's chromium as root"
AXE = Path(__file__).with_name("axe") / "axe.min.js"
WIDE, LAPTOP, PHONE = (1440, 900), (1366, 768), (390, 844)
# A wait in vain ends the test; the times say nothing of what is fast.
WAIT_MS = 120_000
PICTURES = ROOT / "screenshots"


@contextmanager
def chromium() -> Iterator[Browser]:
    """Chromium of the system; skips the test where there is none, and says how to get it."""
    found = next(filter(None, map(shutil.which, NAMES)), None)
    if found is None:
        pytest.skip(MISSING)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        options = ["--no-sandbox"] if os.geteuid() == 0 else []
        browser = playwright.chromium.launch(executable_path=found, args=options)
        yield browser
        browser.close()


class Problems(list[str]):
    """What a page complained of on its console; a test that fails shows it."""

    def add(self, text: str) -> None:
        logging.getLogger(__name__).error(text)
        self.append(text)


def opened(
    browser: Browser,
    url: str,
    size: tuple[int, int] = WIDE,
    scheme: Any = "light",
    ready: str = CONNECTED,
) -> tuple[Page, Problems]:
    """The page in a window of its own, once it is connected, or has what `ready` selects."""
    context = browser.new_context(
        viewport={"width": size[0], "height": size[1]}, color_scheme=scheme
    )
    page, problems = context.new_page(), Problems()
    page.set_default_timeout(WAIT_MS)
    page.on("pageerror", lambda error: problems.add(f"{error}\n{error.stack}"))
    page.on("console", lambda said: problems.add(said.text) if said.type == "error" else None)
    page.goto(url)
    page.wait_for_selector(ready)
    return page, problems


def page_of(team: Team) -> str:
    """The address that `mrbt up --web` has printed."""
    team.wait_for_line("web: ")
    found = re.search(r"web: (\S+)", team.lines())
    assert found is not None
    return found[1]


def picture(page: Page, name: str) -> None:
    """Keep a screenshot of the whole page, for people to look at."""
    PICTURES.mkdir(exist_ok=True)
    page.evaluate("scrollTo(0, 0)")
    page.screenshot(path=PICTURES / f"{name}.png", full_page=True)


def accessibility_violations(page: Page) -> list[str]:
    """What axe-core finds wrong."""
    page.evaluate(AXE.read_text())
    found = page.evaluate("axe.run(document)")["violations"]
    return [
        f"{rule['id']}: {rule['help']}: {[node['html'][:200] for node in rule['nodes']]}"
        for rule in found
    ]
