"""The page of a real team in a real browser."""

from __future__ import annotations

import re
import signal
import subprocess
from typing import TYPE_CHECKING

from tests.support.browser import (
    MARKS,
    PHONE,
    WIDE,
    accessibility_violations,
    opened,
    page_of,
    picture,
)
from tests.support.paths import EXAMPLES
from tests.support.team import REPAIR, Team

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
    page.click(f'button[aria-label="Kill {robot}"]')
    button = page.wait_for_selector(TAKEN_OVER)
    assert button is not None
    found = re.search(rf"{robot} died .* by (\w+) \(", button.inner_text())
    assert found is not None, button.inner_text()
    return found[1]


def test_a_kill_by_its_button_its_detection_and_why(team: Team, browser: Browser) -> None:
    url, robot = at_work(team)
    page, problems = opened(browser, url)
    assert "#" not in page.url, "the token is out of sight"
    # Who has read nothing is told what to do, and what colours and idle robots mean.
    page.wait_for_selector('#why-body:has-text("kill a robot by its button")')
    assert page.inner_text("#map-key").split("\n") == ["not known yet", "good", "bad"]
    page.wait_for_selector('.card .task:has-text("free: ")')
    replacement = killed(team, page, robot)
    assert replacement != robot
    # What the robots did themselves says the same.
    event = team.wait_for_event("do_diagnosis", args=["2"], robot=replacement)
    assert event["robot"] == replacement
    page.wait_for_selector(f'.card[data-state="dead"]:has-text("{robot}")')
    page.click("#takeovers button")
    page.wait_for_selector("#why-body .sentence")
    why = page.inner_text("#why-body")
    assert re.search(rf"{robot} died at .*; the others knew after \d+ ms", why)
    assert re.search(rf"{replacement} took over its {re.escape(HELD)} after \d+ ms", why)
    assert f"{robot}\t" in why
    assert "is dead" in why
    picture(page, "takeover-wide-light")
    # It comes back by its button, and the mission goes on.
    page.click(f'button[aria-label="Start again {robot}"]')
    page.wait_for_selector(f'.card[data-state="alive"]:has-text("{robot}")')
    team.release()
    page.wait_for_selector('#result[data-status="success"]')
    page.wait_for_selector('#banner:has-text("The run is over")')
    code, summary = team.end()
    assert (code, summary["result"]) == (0, "success")
    assert problems == []
    # Of a run that is over the journals still tell the result.
    late, _ = opened(browser, serve(team, "0")[1])
    assert late.get_attribute("#result", "data-status") == "success"


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
    url, _ = at_work(team)
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
    assert page.inner_text("#found") == "1 found"
    assert problems == []


def test_a_drill_file_is_carried_out_on_this_team(team: Team, browser: Browser) -> None:
    url, robot = at_work(team)
    page, problems = opened(browser, url)
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
    page.click(f'button[aria-label="Kill {robot}"]')
    page.wait_for_selector('#toast:has-text("token is missing or wrong")')
    assert team.pid(robot) in {process.pid for process in team.running()}


def test_a_lost_connection_says_so_and_comes_back(team: Team, browser: Browser) -> None:
    """`mrbt watch --web` is an observer: it goes and comes, and the team does not notice."""
    team.hold(HELD)
    team.up(REPAIR)
    team.wait_for_event("do_diagnosis", args=["2"])
    served, url = serve(team, "0")
    page, _ = opened(browser, url)
    assert page.locator('button:has-text("Kill")').count() == 0
    served.kill()
    served.communicate()
    page.wait_for_selector('#banner:has-text("Connection lost")')
    port = re.search(r":(\d+)/", url)
    assert port is not None
    serve(team, port[1])
    page.wait_for_selector("#banner", state="hidden")
    page.wait_for_selector(f'.card:has-text("{HELD}")')
    team.release()
    page.wait_for_selector('#result[data-status="success"]')
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
    page.click(f'button[aria-label="Freeze {robot}"]')
    page.wait_for_selector(f'.card[data-state="dead"]:has-text("{robot}")')
    page.click(f'button[aria-label="Thaw {robot}"]')
    page.wait_for_selector(f'.card[data-state="alive"]:has-text("{robot}")')
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
    page.wait_for_selector('#result[data-status="success"]')
    assert team.end()[0] == 0
    assert problems == []
