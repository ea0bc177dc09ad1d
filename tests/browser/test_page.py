"""The page of a real team in a real browser."""

from __future__ import annotations

import re
import signal
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.support.browser import (
    LAPTOP,
    MARKS,
    PHONE,
    WIDE,
    accessibility_violations,
    opened,
    page_of,
    picture,
)
from tests.support.paths import EXAMPLES, mission_file
from tests.support.team import EXPLORE, REPAIR, Team

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = MARKS

HELD = "do_diagnosis(2)"
TAKEN_OVER = '#takeovers button:has-text("taken over"):not(:has-text("not taken over"))'


def at_work(team: Team) -> tuple[str, str]:
    """A team whose diagnosis of part 2 does not get on: (the page's address, who does it)."""
    team.hold(HELD)
    team.up(REPAIR, "--web", "--control")
    event = team.wait_for_event("do_diagnosis", args=["2"])
    return page_of(team), event["robot"]


def killed(team: Team, page: Page, robot: str) -> str:
    """Kill the robot by its button; the name of its replacement, as the page has it."""
    page.wait_for_selector(f'.card:has-text("{robot}"):has-text("{HELD}")')
    command(page, robot, "Kill")
    button = page.wait_for_selector(TAKEN_OVER)
    assert button is not None
    found = re.search(rf"{robot} died .* by (\w+) \(", button.inner_text())
    assert found is not None, button.inner_text()
    return found[1]


def command(page: Page, robot: str, what: str) -> None:
    """Give a robot an order, by its menu."""
    page.click(f'button[aria-label="Commands to {robot}"]')
    page.click(f'#menu button[aria-label="{what} {robot}"]')


def ended(result: str = "success") -> str:
    """Selects what the page says of a run that has ended."""
    return f'#headline p:has-text("{result} after")'


def test_a_kill_by_its_button_its_detection_and_why(team: Team, browser: Browser) -> None:
    url, robot = at_work(team)
    page, problems = opened(browser, url)
    page.click("#alerts")
    assert "#" not in page.url, "the token is out of sight"
    # Who has read nothing is told what to do, and what colours and idle robots mean.
    page.wait_for_selector('#no-faults:has-text("kill one from its menu")')
    assert page.inner_text("#map-key").split("\n") == ["not known yet", "good", "bad"]
    page.wait_for_selector('.card .task:has-text("free: ")')
    assert page.is_hidden("#why")
    assert page.is_hidden("#jobs"), "the mission has no types of jobs"
    replacement = killed(team, page, robot)
    assert replacement != robot
    # What the robots did themselves says the same.
    event = team.wait_for_event("do_diagnosis", args=["2"], robot=replacement)
    assert event["robot"] == replacement
    page.wait_for_selector(f'.card[data-state="dead"]:has-text("{robot}")')
    page.wait_for_function("document.title.startsWith('⚠ ')")
    # The drawer opens by itself, and the robot in trouble comes first.
    page.wait_for_selector('#why-body .sentence:has-text("took over its")')
    assert robot in page.inner_text(".card >> nth=0")
    why = page.inner_text("#why-body")
    assert re.search(rf"{robot} died at .*; the others knew after [\d.]+ m?s", why)
    assert re.search(rf"{replacement} took over its {re.escape(HELD)} after [\d.]+ m?s", why)
    assert f"{robot}\t" in why
    assert "is dead" in why
    picture(page, "takeover-wide-light")
    # It comes back by its button, and the mission goes on.
    command(page, robot, "Start again")
    page.wait_for_selector(f'.card[data-state="alive"]:has-text("{robot}")')
    team.release()
    page.wait_for_selector(ended())
    # Its server stays after the end of the run, until it is ended too.
    team.wait_for_line("stays until Ctrl-C")
    assert team.running() == []
    again, _ = opened(browser, url)
    again.wait_for_selector(ended())
    again.close()
    page.wait_for_selector(f'#after:has-text("mrbt recording report {team.run_dir}")')
    states = page.locator(".card .state").all_inner_texts()
    assert states == ["■ ended"] * 6
    assert problems == []
    team.interrupt()
    page.wait_for_selector('#headline:has-text("the run is over")')
    code, summary = team.end()
    assert (code, summary["result"]) == (0, "success")
    # Of a run that is over the journals still tell the result.
    late, _ = opened(browser, serve(team, "0")[1], PHONE)
    late.wait_for_selector(ended())
    assert accessibility_violations(late) == []
    assert late.evaluate("document.documentElement.scrollWidth <= innerWidth")
    picture(late, "ended-phone-light")


@pytest.mark.slow
def test_everybody_can_use_it(team: Team, browser: Browser) -> None:
    """axe-core finds nothing, nothing is wider than the window, and a late page has the past."""
    url, robot = at_work(team)
    first, _ = opened(browser, url)
    killed(team, first, robot)
    for size in (WIDE, PHONE):
        for scheme in ("light", "dark"):
            page, problems = opened(browser, url, size, scheme)
            use(page)
            picture(page, f"robot-{'wide' if size == WIDE else 'phone'}-{scheme}")
            page.click("#signs-open")
            assert accessibility_violations(page) == []
            page.click("#signs-close")
            page.click('button[aria-label="Commands to the team"]')
            assert accessibility_violations(page) == []
            page.click('button:has-text("Drills…")')
            page.wait_for_selector('#drills-list li:has-text("kill_at_work")')
            assert accessibility_violations(page) == []
            assert problems == []
            page.close()


def use(page: Page) -> None:
    """Look at what has happened, and at a robot."""
    page.wait_for_selector(TAKEN_OVER)
    page.click("#happened summary")
    page.wait_for_selector("#events li >> nth=5")
    page.click(".card .name >> nth=1")
    page.wait_for_selector("#why-body .own")
    assert page.is_visible("#timeline-legend")
    assert accessibility_violations(page) == []
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_the_tree_that_a_robot_runs_is_seen_as_it_goes_on(team: Team, browser: Browser) -> None:
    team.up(EXAMPLES / "inspection" / "mission.yaml", "--web", speed=0.5)
    page, problems = opened(browser, page_of(team))
    page.wait_for_selector('.card:has-text("R1"):has-text("inspect(")')
    page.click('.card:has-text("R1")')  # wherever on it
    for leaf in ("DriveTo", "ReadGauge"):
        page.wait_for_selector(
            f'#why-body .own [role=listitem]:has(.s-running):has-text("{leaf}(")'
        )
    assert problems == []


def test_the_tree_by_keyboard_and_by_search(team: Team, browser: Browser) -> None:
    url, robot = at_work(team)
    page, problems = opened(browser, url)
    page.uncheck("#fold-finished")
    page.wait_for_selector('.row:has-text("broken(1)")')
    page.focus('.row[aria-level="1"]')
    page.keyboard.press("ArrowDown")
    assert page.get_attribute(".row:focus", "data-index") == "1"
    page.keyboard.press("ArrowUp")
    page.keyboard.press("ArrowLeft")
    assert page.get_attribute(".row:focus", "aria-expanded") == "false"
    assert page.locator(".row").count() == 1
    page.fill("#search", "solder(5)")
    page.wait_for_selector('.row.hit:has-text("solder(5)")')
    assert re.fullmatch(r"0 robots, 1 nodes, \d+ events", page.inner_text("#found"))
    assert page.locator(".card:visible").count() == 0
    # Folded, a node shows who works inside.
    page.fill("#search", "")
    page.click("#fold-all")
    page.wait_for_selector(f'.row .who:has-text("{robot}")')
    assert problems == []


def test_a_drill_file_is_carried_out_on_this_team(team: Team, browser: Browser) -> None:
    url, robot = at_work(team)
    page, problems = opened(browser, url)
    page.click('button[aria-label="Commands to the team"]')
    page.click('button:has-text("Drills…")')
    label = f"kill_at_work[task={HELD},phase=running]"
    page.fill("#drills-search", label)
    page.wait_for_selector(f'#drills-list li:has-text("kill the robots that perform {HELD}")')
    page.click("#drills-list button")
    page.wait_for_selector(TAKEN_OVER)
    page.click("#happened summary")
    page.wait_for_selector(f'#events li:has-text("drill {label}: all steps carried out")')
    assert f"{robot} died" in page.inner_text("#takeovers")
    assert problems == []


def test_orders_without_the_token_are_refused(team: Team, browser: Browser) -> None:
    url, robot = at_work(team)
    page, _ = opened(browser, url.partition("#")[0])
    assert page.locator('button[aria-label^="Commands"]').count() == 0
    page, _ = opened(browser, url.partition("#")[0] + "#wrong")
    command(page, robot, "Kill")
    page.wait_for_selector('#toast:has-text("token is missing or wrong")')
    assert team.pid(robot) in {process.pid for process in team.running()}


def test_a_lost_connection_says_so_and_comes_back(team: Team, browser: Browser) -> None:
    """`mrbt watch --web` is an observer: it goes and comes, and the team does not notice."""
    team.hold(HELD)
    team.up(REPAIR)
    team.wait_for_event("do_diagnosis", args=["2"])
    served, url = serve(team, "0")
    page, _ = opened(browser, url)
    assert page.locator('button[aria-label^="Commands"]').count() == 0
    served.kill()
    served.communicate()
    page.wait_for_selector('#headline:has-text("connection lost")')
    port = re.search(r":(\d+)/", url)
    assert port is not None
    serve(team, port[1])
    page.wait_for_selector('#headline:not(:has-text("connection lost"))')
    page.wait_for_selector(f'.card:has-text("{HELD}")')
    team.release()
    page.wait_for_selector(ended())
    assert team.end()[0] == 0


def serve(team: Team, port: str) -> tuple[subprocess.Popen[str], str]:
    """`mrbt watch --web` in the background, and the address that it prints."""
    process = team.start("watch", "--web", "--run-dir", str(team.run_dir), "--port", port)
    assert process.stdout is not None
    found = re.search(r"web: (\S+)", process.stdout.readline())
    assert found is not None
    return process, found[1]


def test_a_frozen_robot_is_thawed_by_its_button(team: Team, browser: Browser) -> None:
    url, robot = at_work(team)
    page, problems = opened(browser, url)
    page.wait_for_selector(f'.card:has-text("{robot}"):has-text("{HELD}")')
    command(page, robot, "Freeze")
    page.wait_for_selector(f'.card[data-state="dead"]:has-text("{robot}")')
    command(page, robot, "Thaw")
    page.wait_for_selector(f'.card[data-state="alive"]:has-text("{robot}")')
    # Cards move while one of them has the focus: none gets lost.
    page.focus('.card:has-text("B1") .name')
    team.mrbt("kill", "C1")
    page.wait_for_selector('.card[data-state="dead"]:has-text("C1")')
    assert page.locator(".card").count() == 6
    assert page.locator('.card:has-text("B1") .name').evaluate("e => e === document.activeElement")
    team.interrupt()
    team.end()
    assert problems == []


def test_a_page_that_is_opened_late_shows_the_whole_past(team: Team, browser: Browser) -> None:
    """A server that comes after a death knows it from the recording of `mrbt up`."""
    team.hold(HELD)
    team.up(REPAIR)
    event = team.wait_for_work(team.wait_for_event("do_diagnosis", args=["2"]))
    team.signal(event["robot"], signal.SIGKILL)
    replacement = team.wait_for_work(team.wait_for_replacement(event))
    page, problems = opened(browser, serve(team, "0")[1])
    page.wait_for_selector(f'.card[data-state="dead"]:has-text("{event["robot"]}")')
    told = page.inner_text(TAKEN_OVER)
    assert re.search(rf"{event['robot']} died at .* by {replacement['robot']} \(", told), told
    page.click("#happened summary")
    page.wait_for_selector('#events li:has-text("use_screwdriver done")')
    assert page.locator('#events li:has-text("screwdriver"):has-text("(earlier)")').count() == 0
    picture(page, "late-wide-light")
    # It goes on from there.
    team.release()
    page.wait_for_selector(ended())
    assert team.end()[0] == 0
    assert problems == []


@pytest.mark.slow
def test_all_runs_of_the_machine_and_the_way_to_the_next_one(
    team: Team, browser: Browser, tmp_path: Path
) -> None:
    team.hold(HELD)
    team.up(REPAIR)
    robot = team.wait_for_event("do_diagnosis", args=["2"])["robot"]
    (tmp_path / "other").mkdir()
    with Team(tmp_path / "other") as other:
        other.environment["MRBT_STATE_DIR"] = team.environment["MRBT_STATE_DIR"]
        other.up(EXPLORE, speed=0.01)
        other.wait_for_event("explore")
        process = team.start("watch", "--web", "--port", "0")
        assert process.stdout is not None
        found = re.search(r"web: (\S+)", process.stdout.readline())
        assert found is not None
        for size in (WIDE, LAPTOP, PHONE):
            for scheme in ("light", "dark"):
                page, problems = opened(browser, found[1], size, scheme, "#runs li >> nth=1")
                assert accessibility_violations(page) == []
                assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
                page.close()
        page, problems = opened(browser, found[1], ready="#runs li >> nth=1")
        team.signal(robot, signal.SIGKILL)
        row = '#runs li:has-text("vehicle_repair")'
        page.wait_for_selector(f'{row}:has-text("1 dead: {robot}"):has-text("5 of 6 alive")')
        # By keyboard alone: to the page of a team, to the next run, and back to the list.
        page.focus(f"{row} a")
        page.keyboard.press("Enter")
        page.wait_for_selector(f'.card[data-state="dead"]:has-text("{robot}")')
        team.interrupt()
        team.end()
        page.wait_for_selector('#headline p:has-text("the run is over: ")')
        page.focus('#next a:has-text("open explore-")')
        assert accessibility_violations(page) == []
        page.keyboard.press("Enter")
        page.wait_for_selector('#mission:has-text("explore")')
        page.focus("#above")
        page.keyboard.press("Enter")
        page.wait_for_selector('#runs-hint:has-text("1 of 2 running")')
        assert problems == []


def test_another_run_on_the_same_port_is_offered_and_never_mixed(
    team: Team, browser: Browser, tmp_path: Path
) -> None:
    team.hold(HELD)
    team.up(REPAIR, "--web")
    team.wait_for_event("do_diagnosis", args=["2"])
    url = page_of(team)
    page, problems = opened(browser, url)
    team.interrupt()
    team.end()
    page.wait_for_selector('#headline:has-text("the run is over")')
    (tmp_path / "next").mkdir()
    with Team(tmp_path / "next") as following:
        port = re.search(r":(\d+)/", url)
        assert port is not None
        following.up(EXPLORE, "--web", "--port", port[1], speed=0.01)
        page.wait_for_selector('#next:has-text("Another run has begun")')
        assert page.inner_text("#mission") == "vehicle_repair"
        assert page.locator('.card:has-text("R1")').count() == 0
        page.click("#next a")
        page.wait_for_selector('.card:has-text("R1")')
        assert page.inner_text("#mission") == "explore"
    assert [each for each in problems if "ERR_CONNECTION" not in each] == []


@pytest.mark.slow
def test_the_future_of_robots_that_travel_is_shown_until_they_are_done(
    team: Team, browser: Browser
) -> None:
    team.hold("C1", "C2", "C3", "L1", "L2", "S1")
    team.up(mission_file("depot"), "--web")
    page, problems = opened(browser, page_of(team), LAPTOP)
    page.wait_for_selector('#forecast:has-text("for makespan, 14 tasks, ends at")')
    # The tips of the lane of C1, from its begin to its end.
    lane, tips = page.locator("#spans"), set()
    box = lane.bounding_box()
    assert box is not None
    for x in range(80, int(box["width"]), 8):
        lane.hover(position={"x": x, "y": 12})
        tips.add(page.inner_text("#tip"))
    assert any("expected from" in each for each in tips), tips
    assert accessibility_violations(page) == []
    picture(page, "forecast")
    team.release()
    page.wait_for_selector(ended())
    page.wait_for_selector("#forecast", state="hidden")
    assert problems == []
