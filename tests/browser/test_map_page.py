"""The map: where robots and labels go, which do not fit, and what changes when it is zoomed."""

from __future__ import annotations

import math
from itertools import combinations
from typing import TYPE_CHECKING, Any

import pytest

from tests.support.browser import MARKS, PHONE, WIDE, accessibility_violations
from tests.support.told_page import robot, told_mission, told_page

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = MARKS

# Boxes of what is drawn, as [left, top, right, bottom].
BOXES = """texts => texts.map(each => each.getBoundingClientRect())
    .map(({left, top, right, bottom}) => [left, top, right, bottom])"""


def layout(page: Page, call: str) -> Any:
    """What a function of the layout returns."""
    return page.evaluate(f"import('/static/map_layout.mjs').then(map => map.{call})")


def overlapping(boxes: list[list[float]]) -> list[tuple[list[float], list[float]]]:
    """Pairs that cover each other by more than a pixel."""
    return [
        (a, b)
        for a, b in combinations(boxes, 2)
        if min(a[2], b[2]) - max(a[0], b[0]) > 1 and min(a[3], b[3]) - max(a[1], b[1]) > 1
    ]


@pytest.fixture
def page(browser: Browser) -> Page:
    return told_page(browser, told_mission("deliveries"), {})[0]


@pytest.mark.parametrize("count", [2, 3, 6, 12])
def test_robots_of_one_place_fan_out_around_it_and_none_covers_another(
    page: Page, count: int
) -> None:
    spots = layout(page, f"fan({count}, 7, 1000)")
    assert len(spots) == count
    distances = [math.dist(*map(_point, pair)) for pair in combinations(spots, 2)]
    assert min(distances) >= 14


def _point(spot: dict[str, float]) -> tuple[float, float]:
    return spot["x"], spot["y"]


def test_where_neighbours_are_near_they_are_a_stack_and_one_alone_is_in_its_place(
    page: Page,
) -> None:
    assert layout(page, "fan(6, 7, 40)") is None
    assert layout(page, "fan(1, 7, 1)") == [{"x": 0, "y": 0}]


def test_sizes_follow_the_distance_of_neighbours(page: Page) -> None:
    places = "[[0, 0], [3, 4], [30, 0], [30, 5]]"
    assert layout(page, f"neighbourDistance({places})") == 5
    assert layout(page, "neighbourDistance([[1, 1]])") == math.inf, "there is none"
    small, large = layout(page, "sizes(20)"), layout(page, "sizes(45)")
    assert small["place"] == pytest.approx(6)
    assert large["place"] > small["place"]
    assert layout(page, "sizes(Infinity)")["place"] == 16


def test_the_map_fills_its_pane(page: Page) -> None:
    fit = layout(page, "fitted([0, 0, 40, 10], 460, 300, 30)")
    assert fit == {"scale": 10, "shiftX": 30, "shiftY": 100}


def test_labels_that_would_overlap_are_left_out_but_for_those_that_are_needed(page: Page) -> None:
    label = "{x: 100, y: 100, radius: 8, width: 60, owner: 'OWN'}"
    labels = ", ".join(label.replace("OWN", f"{i}") for i in range(12))
    found = [each for each in layout(page, f"placed([{labels}], [], 400, 400)") if each]
    assert 3 <= len(found) < 12
    boxes = [[x - 30, y - 7, x + 30, y + 7] for x, y in map(_point, found)]
    assert overlapping(boxes) == []
    wall = ", ".join(
        f"{{x: {x}, y: {y}, radius: 9, owner: 'wall'}}"
        for x in range(0, 210, 15)
        for y in range(0, 210, 15)
    )
    own = label.replace("OWN", "own")
    assert layout(page, f"placed([{own}], [{wall}], 400, 400)") == [None]
    needed = own.replace("}", ", isNeeded: true}")
    assert layout(page, f"placed([{needed}], [{wall}], 400, 400)") != [None]
    assert layout(page, f"placed([{needed}], [], 50, 50)") == [None], "beyond the edge"


def test_a_route_ends_at_the_edge_of_its_goal(page: Page) -> None:
    assert layout(page, "route({x: 0, y: 0}, {x: 10, y: 0}, 4)") == [0, 0, 6, 0]
    assert layout(page, "route({x: 0, y: 0}, {x: 3, y: 0}, 4)") is None


def items() -> dict[str, Any]:
    """12 robots at one station, two on their way, one that is dead."""
    found = {f"robot/C{i}": robot("station_1") for i in range(1, 13)}
    found["robot/D1"] = robot("shelf_1", under_way="dock_1", phase="travelling")
    found["robot/D2"] = robot("shelf_4", under_way="dock_3", phase="travelling")
    found["position/D2"] = {"x": 15.0, "y": 10.5, "heading": 0.3}
    found["robot/C20"] = robot("shelf_6", state="dead")
    return found


@pytest.mark.parametrize("size", [WIDE, PHONE], ids=["wide", "phone"])
def test_a_stack_has_a_count_and_is_robots_once_there_is_room(
    browser: Browser, size: tuple[int, int]
) -> None:
    page, problems = told_page(browser, told_mission("deliveries"), items(), size=size)
    page.locator("#map").scroll_into_view_if_needed()
    page.wait_for_selector(".map-stack")
    assert page.inner_text("#map-hint") == "15 robots"
    assert page.locator(".map-stack text").all_text_contents() == ["12"]
    assert page.locator(".map-route").count() == 2
    assert page.locator('.map-labels text:has-text("✕ C20")').count() == 1
    assert overlapping(page.eval_on_selector_all(".map-labels text", BOXES)) == []
    stack = page.locator(".map-stack")
    stack.hover()
    assert page.text_content(".map-over text") == " ".join(f"C{i}" for i in range(1, 13))
    for _ in range(4):
        page.locator("#map-in").click()
    page.locator("#map-fit").click()
    page.wait_for_selector(".map-stack")
    for _ in range(4):
        if page.locator(".map-stack").count():
            page.locator(".map-stack").click()
    assert page.locator(".map-stack").count() == 0
    assert page.locator('.map-robot[data-robot^="C"]').count() >= 12
    assert overlapping(page.eval_on_selector_all(".map-labels text", BOXES)) == []
    page.locator('.map-robot[data-robot="C10"]').click()
    page.wait_for_selector('.card.selected .name:text-is("C10")')
    assert accessibility_violations(page) == []
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    assert [text for text in problems if "404" not in text] == []
