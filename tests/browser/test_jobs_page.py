"""The jobs of a real team on its page: handed in by the form, changed by their menus."""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import TYPE_CHECKING

import pytest

from tests.support.browser import (
    MARKS,
    PHONE,
    WIDE,
    accessibility_violations,
    opened,
    page_of,
    picture,
)
from tests.support.paths import mission_file
from tests.support.team import Team

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = MARKS

ROW = '#jobs-list tr:has-text("{}"):has(.job-state:has-text("{}"))'


def change(page: Page, job: str, what: str) -> None:
    """Change a job, by its menu."""
    page.click(f'#jobs-list tr:has-text("{job}") button.more')
    page.click(f'#menu button:has-text("{what}")')


def submit(page: Page, kind: str, **values: str) -> None:
    """Fill the form in and send it; it is open."""
    page.select_option("#submit-type", kind)
    for name, value in values.items():
        field = page.locator(f"#submit-{name}")
        if field.evaluate("each => each.tagName") == "SELECT":
            field.select_option(value)
        else:
            field.fill(value)
    page.click('#submit-form button:has-text("Submit")')


@pytest.mark.parametrize("size", [WIDE, PHONE], ids=["wide", "phone"])
def test_jobs_are_submitted_changed_and_refused(
    team: Team, browser: Browser, size: tuple[int, int]
) -> None:
    team.hold("look", "take")
    team.up(mission_file("deliveries"), "--web", "--control", speed=20)
    scheme = "light" if size == WIDE else "dark"
    page, problems = opened(browser, page_of(team), size, scheme)
    page.click("#submit-open")
    submit(page, "inspect", **{"argument-where": "shelf_3"})
    page.wait_for_selector('#submit-form [role=alert]:has-text("submitted: ")')
    later = f"{datetime.now() + timedelta(hours=2):%Y-%m-%dT%H:%M}"
    submit(page, "inspect", **{"argument-where": "shelf_6", "not-before": later})
    page.wait_for_selector('#jobs-list tr:has-text("inspect(shelf_6)"):has-text("not before 2")')
    delivery = {"argument-shelf": "shelf_1", "argument-dock": "dock_2", "argument-boxes": "3"}
    submit(page, "deliver", **delivery)
    page.wait_for_selector(ROW.format("deliver(shelf_1, dock_2, 3)", "running"))
    # What robots refuse is said where it was asked for.
    submit(page, "deliver", **delivery, priority="100000")
    page.wait_for_selector(
        '#submit-form [role=alert]:has-text("a priority is a whole number from")'
    )
    assert accessibility_violations(page) == []
    picture(page, f"jobs-form-{'wide' if size == WIDE else 'phone'}")
    page.click("#submit-close")
    # Both drones look at something that they are held at: one more waits.
    for where in ("shelf_4", "shelf_5"):
        team.mrbt("submit", "inspect", where)
    page.wait_for_selector('#jobs-hint:has-text("3 running, 2 waiting")')
    waiting = page.inner_text(ROW.format("inspect", "waiting") + ':not(:has-text("before")) .name')
    change(page, waiting, "Hold")
    page.wait_for_selector(ROW.format(waiting, "held"))
    page.click(f'#jobs-list tr:has-text("{waiting}") button.more')
    page.fill('#menu input[aria-label="New priority"]', "7")
    assert accessibility_violations(page) == []
    picture(page, f"jobs-menu-{'wide' if size == WIDE else 'phone'}")
    page.click('#menu button:has-text("Set priority")')
    page.wait_for_selector(f'#jobs-list tr:has-text("{waiting}"):has(.job-priority:text-is("7"))')
    change(page, waiting, "Release")
    page.wait_for_selector('#jobs-hint:has-text("3 running, 2 waiting, 0 held")')
    change(page, "deliver(shelf_1, dock_2, 3)", "Cancel")
    page.wait_for_selector(ROW.format("deliver(shelf_1, dock_2, 3)", "cancelled"))
    team.release()
    page.wait_for_selector(ROW.format("inspect(shelf_3)", "succeeded"))
    page.wait_for_selector('#jobs-hint:has-text("0 running, 1 waiting, 0 held, 4 ended")')
    assert accessibility_violations(page) == []
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    picture(page, f"jobs-{'wide' if size == WIDE else 'phone'}")
    assert [text for text in problems if "422" not in text] == []


def test_a_page_without_control_shows_jobs_and_changes_none(team: Team, browser: Browser) -> None:
    team.hold("look")
    team.up(mission_file("deliveries"), "--web", speed=20)
    page, problems = opened(browser, page_of(team))
    team.mrbt("submit", "inspect", "shelf_2", "--id", "one")
    page.wait_for_selector(ROW.format("inspect(shelf_2)", "running"))
    assert page.is_hidden("#submit-open")
    assert page.locator("#jobs-list button.more").count() == 0
    refused = page.evaluate(
        """async () => (await fetch("v1/jobs/one/cancel", {method: "POST", body: "{}",
        headers: {"content-type": "application/json"}})).json()"""
    )
    assert refused["detail"] == "this page only watches: start it with --control"
    assert len(problems) == 1
    assert "403" in problems[0]
