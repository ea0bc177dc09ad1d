"""docker-compose.yml: each robot in a container, found by multicast, killed and brought back."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial

import pytest

from mrbt_mesh.drills.physical import spans
from tests.support.docker_compose import ROBOTS, ROUTED_OBSERVER, Compose
from tests.support.paper_run import check_order

pytestmark = [pytest.mark.docker, pytest.mark.processes, pytest.mark.timeout(1_500)]


def test_a_killed_container_is_replaced_and_comes_back_with_its_journal(
    compose: Compose, say: Callable[[str], None]
) -> None:
    compose.hold("B1", "replace_hw")
    compose("up", "-d")
    lines = compose.observer()
    part = lines.until(r"B1: do_diagnosis\((\d)\) for")[1]
    watching = compose.start("run", "--rm", "-T", "observer", "mrbt", "watch", "--json")
    compose("kill", "b1")
    _, started = lines.until_all("B1 is dead", rf"(\w\d): do_diagnosis\({part}\) for")
    replacement = started[1]
    assert replacement in {"A1", "A2", "B2"}
    compose("start", "b1")
    lines.until("B1 is back")
    compose.hold()
    lines.until("mission: success")
    detected, taken_over = lines.until(
        rf"B1 died, detected after about ([\d.]+ m?s), while on do_diagnosis\({part}\), "
        rf"replaced by {replacement} after about ([\d.]+ m?s)"
    ).groups()
    say(f"b1 killed: detected after {detected}, replaced after {taken_over}")
    assert compose.docker("wait", compose.container("observer")).strip() == "0"

    events = compose.events()
    check_order(spans(events))
    of_b1 = [e for e in events if e["robot"] == "B1" and e["incarnation"].startswith("1.")]
    assert [(e["event"], e["global_task"]) for e in of_b1] == [("start", f"diagnose_part({part})")]
    done = [e for e in events if e["activation"] == of_b1[0]["activation"] and e["outcome"]]
    assert [(e["robot"], e["outcome"]) for e in done] == [(replacement, "success")]
    log = compose.log("b1")
    assert [line["incarnation"][:2] for line in log if line["event"] == "joined"] == ["1.", "2."]
    assert not [line for line in log if line["event"] == "journal_set_aside"]

    output, _ = watching.communicate()
    assert watching.returncode == 0
    assert json.loads(output)["result"] == "success"
    robots_stay_on_duty_and_show_their_health(compose)
    the_page_and_robots_are_scraped_under_their_names(compose)


def robots_stay_on_duty_and_show_their_health(compose: Compose) -> None:
    status = json.loads(compose("exec", "-T", "a1", "mrbt", "status", "--json"))
    assert {name: row["host"] for name, row in status["robots"].items()} == {
        robot.upper(): robot for robot in ROBOTS
    }
    assert status["result"] == "success"
    health = ["inspect", "--format", "{{.State.Health.Status}}", compose.container("c2")]
    compose.wait_until(lambda: compose.docker(*health).strip() == "healthy", "c2 is healthy")
    pid = status["robots"]["C2"]["pid"]
    compose("exec", "-T", "c2", "sh", "-c", f"kill -STOP {pid}")
    compose.wait_until(lambda: not compose.is_well("c2"), "a frozen robot is not well")
    compose("exec", "-T", "c2", "sh", "-c", f"kill -CONT {pid}")
    compose.wait_until(lambda: compose.is_well("c2"), "a thawed robot is well again")
    compose("stop", "a2")
    stopped = ["inspect", "--format", "{{.State.ExitCode}}", compose.container("a2")]
    assert compose.docker(*stopped).strip() == "0"
    assert compose.log("a2")[-1]["reason"] == "left"


@pytest.mark.slow
def test_a_team_killed_as_a_whole_goes_on_and_a_new_name_starts_afresh(compose: Compose) -> None:
    compose.hold("replace_hw")
    compose("up", "-d")
    lines = compose.observer()
    lines.until(r"diagnose_part\(\d\)")
    told = lines.until(r"(\w\d): (do_diagnosis)\((\d)\) done")
    compose("kill")
    before = compose.events()
    (done,) = [
        e["activation"]
        for e in before
        if (e["robot"], e["local_task"], *e["args"], e["outcome"]) == (*told.groups(), "success")
    ]
    compose.hold()
    compose("up", "-d")
    lines = compose.observer()
    lines.until("mission: success")
    events = compose.events()
    check_order(spans(events))
    assert done not in {e["activation"] for e in events[len(before) :]}
    first = {event["activation"].partition(":")[0] for event in events}
    assert first == {"demo"}

    compose("up", "-d")
    again = compose.observer()
    again.until("mission: success")
    assert compose.events() == events, "a finished run is finished"


@pytest.mark.slow
def test_a_team_on_two_networks_goes_on_when_the_router_in_use_is_killed(compose: Compose) -> None:
    compose.hold("replace_hw")
    compose("--profile", "router", "up", "-d", ROUTED_OBSERVER)
    lines = compose.observer(ROUTED_OBSERVER)
    lines.until(r"replace_hw\(\d\) for")
    compose("--profile", "router", "kill", "router1")
    compose.hold()
    lines.until("mission: success")
    assert not [line for line in lines.seen if "is dead" in line]
    assert compose.docker("wait", compose.container(ROUTED_OBSERVER)).strip() == "0"


def the_page_and_robots_are_scraped_under_their_names(compose: Compose) -> None:
    """As deploy/prometheus/compose.yml has it; the page answers to no other name."""
    compose("--profile", "metrics", "up", "-d", "page")
    for target, sample in (("b2:9464", "mrbt_joined 1.0"), ("page:8000", "mrbt_team_agreement")):
        read = f"urlopen('http://{target}/metrics', timeout=5).read().decode()"
        program = f"from urllib.request import urlopen; print({read})"
        served = partial(serves, compose, program, sample)
        compose.wait_until(served, f"{target} serves {sample}")


def serves(compose: Compose, program: str, sample: str) -> bool:
    """Whether a program prints this in a1's container; it fails until the page is there."""
    try:
        return sample in compose("exec", "-T", "a1", "python3", "-c", program)
    except AssertionError:
        return False
