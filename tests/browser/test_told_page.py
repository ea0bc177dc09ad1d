"""What the page shows of the state that it is given: jobs, revisions, what happens next, order."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import pytest

from tests.support.browser import MARKS, PHONE, WIDE, accessibility_violations
from tests.support.told_page import TEAM, job, robot, told_mission, told_page

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = MARKS

NOON = datetime(2026, 5, 4, 12, tzinfo=UTC)
NOON_US = int(NOON.timestamp() * 1e6)


def cells(page: Page, name: str) -> list[str]:
    return page.locator(f"#jobs-list td.job-{name}").all_inner_texts()


def jobs() -> dict[str, Any]:
    """At 100 s of the run."""
    times = {"deadline_us": NOON_US, "state": "running", "since_s": 60.0}
    return {
        "job/j2": job("j2", **times, deadline_s=280.0, priority=5, robots=["C2", "C10"]),
        "job/j10": job("j10", **times, deadline_s=-140.0, priority=5, robots=["C1"]),
        "job/j3": job("j3", why="blocked: look needs 1, 0 alive"),
        "job/j1": job("j1", state="succeeded", since_s=40.0, priority=None, robots=["D1"]),
    }


@pytest.mark.parametrize("size", [WIDE, PHONE], ids=["wide", "phone"])
def test_jobs_have_columns_and_deadlines_that_count_from_now(
    browser: Browser, size: tuple[int, int]
) -> None:
    page, _ = told_page(browser, told_mission("deliveries"), jobs(), size=size)
    page.wait_for_selector("#jobs-list tr")
    headers = page.locator("#jobs-table th").all_text_contents()
    assert headers == ["job", "state", "who", "priority", "deadline", "since", "change"]
    ids = page.locator("#jobs-list .job-id").all_inner_texts()
    assert ids == ["j3", "j2", "j10", "j1"], "what is blocked first, and 2 before 10"
    assert [text.strip() for text in cells(page, "deadline")] == ["", "in 3 min", "4 min late", ""]
    title = page.get_attribute('#jobs-list tr:has-text("j2") td.job-deadline', "title")
    assert title == "2026-05-04 12:00:00 UTC"
    assert cells(page, "who")[1:] == ["C2, C10", "C1", "D1"]
    assert cells(page, "since")[1:] == ["40 s", "40 s", "60 s"]
    assert page.inner_text("#jobs-hint") == "1 blocked, 2 running, 0 waiting, 0 held, 1 ended"
    assert page.is_hidden("#jobs-none")
    assert accessibility_violations(page) == []
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_of_a_run_that_is_over_jobs_are_left_open(browser: Browser) -> None:
    team = TEAM | {"ended": "ended", "ended_s": 100.0}
    page, _ = told_page(browser, told_mission("deliveries"), jobs() | {"team": team})
    page.wait_for_selector('#jobs-hint:text-is("3 left open, 1 ended")')
    assert cells(page, "state")[0] == "◷ left open"
    assert cells(page, "deadline")[1] == "12:00:00"
    assert page.is_hidden("#why"), "nothing is blocked any more"


def test_without_jobs_the_command_that_submits_one_is_told(browser: Browser) -> None:
    page, _ = told_page(browser, told_mission("deliveries"), {})
    page.wait_for_selector("#jobs-none")
    assert page.inner_text("#jobs-none code") == "mrbt submit deliver shelf_1 dock_1 1"
    assert page.is_hidden("#jobs-table")
    assert accessibility_violations(page) == []


def test_the_drawer_opens_on_a_blocked_job_and_counts_down(browser: Browser) -> None:
    told = {
        "subject": "job j3",
        "sentence": "j3 is waiting: watch(shelf_1) is blocked.",
        "groups": [],
        "next": [
            {"text": "fails", "at_s": 120.0},
            {"text": "start D1 (`mrbt join D1`)", "at_s": None},
        ],
    }
    answers = {"why/job/j3": told}
    page, _ = told_page(browser, told_mission("deliveries"), jobs(), answers)
    page.wait_for_selector('#why-body .sentence:has-text("is blocked")')
    assert page.locator("#why-body .steps li").all_inner_texts() == [
        "fails in 20 s",
        "start D1 (mrbt join D1)",
    ]
    assert page.inner_text("#why-body .steps code") == "mrbt join D1"
    assert accessibility_violations(page) == []


def test_the_revision_in_force_and_the_one_that_is_pending(browser: Browser) -> None:
    mission = told_mission("deliveries") | {"revision": 3}
    pending = {"number": 4, "by": "anna", "awaited": ["C2", "C10"]}
    team = TEAM | {"revision": 3, "pending": pending}
    page, _ = told_page(browser, mission, {"team": team})
    page.wait_for_selector("#revision")
    assert page.inner_text("#revision") == "revision 3, revision 4 pending"
    assert page.get_attribute("#revision", "title") == "proposed by anna, waits for C2, C10"
    assert accessibility_violations(page) == []
    page, _ = told_page(browser, told_mission("deliveries"), {"team": TEAM})
    assert page.is_hidden("#revision"), "of the first mission nothing is said"


def test_a_dead_robot_has_the_first_lane_and_the_first_row(browser: Browser) -> None:
    robots = {f"robot/C{i}": robot("station_1") for i in range(1, 25)}
    robots["robot/C24"] = robot("station_1", state="dead")
    robots["robot/C11"] = robot("station_1", problems=["its journal cannot be written"])
    fault = {"robot": "C24", "at_s": 90.0, "detected_ms": 500, "detected_after": "0.50 s"}
    fault |= {"taken_over_ms": None, "taken_over_after": None, "until_s": None, "held": None}
    items = robots | {"fault/0": fault | {"wanted": False, "older": False, "replacement": None}}
    page, _ = told_page(browser, told_mission("deliveries"), items)
    page.wait_for_selector('.card[data-state="dead"]')
    names = page.locator(".card .name").all_inner_texts()
    assert names[:4] == ["C24", "C11", "C1", "C2"]
    assert names.index("C3") < names.index("C10")
    lane, tips = page.locator("#spans"), set()
    box = lane.bounding_box()
    assert box is not None
    for x in range(80, int(box["width"]), 6):
        lane.hover(position={"x": x, "y": 10})
        tips.add(page.inner_text("#tip"))
    assert any(each.startswith("C24 died at 90.0 s") for each in tips), tips


def test_a_condition_that_does_not_hold_is_no_failure(browser: Browser) -> None:
    tree = [
        {"kind": "Sequence", "label": "Sequence", "name": "", "subject": "", "parent": -1},
        {"kind": "Condition", "label": "charged", "name": "", "subject": "charged", "parent": 0},
        {"kind": "Action", "label": "drive", "name": "", "subject": "drive", "parent": 0},
    ]
    own = {name: {"tree": tree, "statuses": [3, 3, 3]} for name in ("T_A", "T_Li")}
    why = {"subject": "C1", "sentence": "C1 does nothing now.", "groups": [], "next": []}
    answers = {"trees/C1": own, "why/robot/C1": why}
    mission = told_mission("deliveries")
    page, _ = told_page(browser, mission, {"robot/C1": robot("station_1")}, answers)
    page.click('.card .name:text-is("C1")')
    rows = page.locator('#why-body .own[aria-label="T_Li"] [role=listitem] > :first-child')
    rows.nth(2).wait_for()
    assert rows.evaluate_all("all => all.map(each => each.className)") == [
        "s-failure",
        "s-idle",
        "s-failure",
    ]
