"""The page of a recording in a real browser."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from mrbt_mesh.recording.folder import observer_file
from mrbt_mesh.sim import Kill
from tests.support.browser import (
    LAPTOP,
    MARKS,
    PHONE,
    WIDE,
    accessibility_violations,
    opened,
    picture,
)
from tests.support.paths import ROOT
from tests.support.recorded import record_example

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = MARKS

KILLED_US = 12_500_000


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording of a run in which A1 dies at work."""
    folder = tmp_path_factory.mktemp("one")
    record_example(folder, "vehicle_repair", 7, [(KILLED_US, Kill("A1"))])
    return observer_file(folder)


@pytest.fixture(scope="module")
def url(recorded: Path) -> Iterator[str]:
    """The page of the run, shown from its 8th second."""
    with served(recorded, "--at", "8") as found:
        yield found


@contextmanager
def served(file: Path, *options: str) -> Iterator[str]:
    """`mrbt recording replay FILE --web` as long as the block runs: the address that it prints."""
    process = subprocess.Popen(
        [sys.executable, "-m", "mrbt_mesh", "recording", "replay", str(file), "--web", *options],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        found = re.search(r"page: (\S+)", process.stdout.readline())
        assert found is not None
        yield found[1]
    finally:
        process.terminate()
        process.communicate()
    assert process.returncode == 0


def paused(page: Page) -> None:
    page.click('#play[aria-label="Pause"]')
    page.wait_for_selector('#play[aria-label="Play"]')


def place_s(page: Page) -> float:
    return float(page.inner_text("#place-text").partition(" ")[0])


def test_a_death_is_found_by_its_mark_and_undone_by_going_back(url: str, browser: Browser) -> None:
    page, problems = opened(browser, url)
    page.wait_for_selector("#takeovers button")
    assert page.locator('.card[data-state="dead"]').count() == 0, "it has not come yet"
    assert page.locator('button[aria-label^="Commands"]').count() == 0
    paused(page)
    page.click("#next-fault")
    page.wait_for_selector('.card[data-state="dead"]:has-text("A1")')
    page.wait_for_selector('#headline p:has-text("1 dead: A1")')
    assert "no robot is heard" not in page.inner_text("#headline")
    assert place_s(page) == pytest.approx(12.5, abs=0.2)
    page.click("#takeovers button")
    page.wait_for_selector('#why-body .sentence:has-text("took over its")')
    picture(page, "replay-wide-light")
    # Back by the keys, and by the slider's: nothing of what comes later remains.
    page.click("#mission")
    page.keyboard.press("ArrowLeft")
    page.wait_for_selector('.card[data-state="alive"]:has-text("A1")')
    assert place_s(page) == pytest.approx(7.5, abs=0.2)
    page.focus("#place")
    page.keyboard.press("End")
    page.wait_for_selector('#headline:has-text("success after")')
    page.keyboard.press("Home")
    page.wait_for_selector('#headline:has-text("waiting for robots")')
    # On at the greatest speed, to the end, where it pauses.
    page.select_option("#speed", "64")
    page.keyboard.press("n")
    page.wait_for_selector('.card[data-state="dead"]:has-text("A1")')
    page.click("#mission")
    page.keyboard.press(" ")
    page.wait_for_selector('#headline:has-text("success after")')
    page.wait_for_selector('#play[aria-label="Play"]')
    assert problems == []


def test_a_link_leads_to_a_moment(url: str, browser: Browser) -> None:
    page, problems = opened(browser, f"{url}?t=14.25")
    page.wait_for_selector('#play[aria-label="Play"]')
    assert place_s(page) == pytest.approx(14.25, abs=0.1)
    page.click("#link")
    page.wait_for_selector('#toast:has-text("?t=14.25")')
    page.click('.card[data-state="dead"] .name')
    page.wait_for_selector('#why-body .events li:has-text("died at it")')
    assert problems == []


def test_everybody_can_use_it(url: str, browser: Browser) -> None:
    for size, scheme in ((WIDE, "light"), (LAPTOP, "light"), (LAPTOP, "dark"), (PHONE, "dark")):
        page, problems = opened(browser, url, size, scheme)
        page.click("#takeovers button")
        page.wait_for_selector('.card[data-state="dead"]:has-text("A1")')
        page.wait_for_selector('#why-body .sentence:has-text("took over its")')
        picture(page, f"replay-{'wide' if size == WIDE else 'phone'}-{scheme}")
        assert accessibility_violations(page) == []
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        heights = "[...document.querySelectorAll('#timeline .head button')].map(e => e.offsetTop)"
        assert len({top for top in page.evaluate(heights) if top}) == 1, "in one row"
        assert problems == []
        page.close()
