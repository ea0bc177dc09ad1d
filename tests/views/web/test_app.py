"""The routes: files, explanations, commands, and who is refused."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import sys
from pathlib import Path
from typing import Any

import httpx2 as httpx
import pytest
from prometheus_client.openmetrics.parser import text_string_to_metric_families as parse_openmetrics
from prometheus_client.parser import text_string_to_metric_families as parse_text
from starlette.testclient import TestClient

from mrbt_mesh.drills.control import CommandError
from mrbt_mesh.views.model.team_view import TeamView
from mrbt_mesh.views.web.app import STATIC, Page
from mrbt_mesh.views.web.feed import Feed
from mrbt_mesh.views.web.protection import own_names
from tests.support.watched import WELD, watched

TOKEN = "a-token"
HOST = "127.0.0.1:8000"
GOOD = {"x-mrbt-token": TOKEN, "content-type": "application/json"}


class Commands:
    """Takes commands instead of a team."""

    def __init__(self) -> None:
        self.taken: list[Any] = []
        self.problem = ""

    def offers(self) -> dict[str, Any]:
        return {"robot": {}, "team": {}, "drills": True}

    async def drills(self) -> list[dict[str, Any]]:
        if self.problem:
            raise CommandError(self.problem)
        return [{"label": "one"}]

    async def carry_out(self, command: Any) -> str:
        if command == "wrong":
            raise CommandError("no such command")
        self.taken.append(command)
        return "done"


@pytest.fixture
def commands() -> Commands:
    return Commands()


def client(commands: Commands | None, run_dir: Path | None = None) -> TestClient:
    script, observer = watched(WELD)
    feed = Feed(TeamView(observer), lambda: script.team.now_us)
    feed.update()
    own = own_names(["127.0.0.1", "localhost", "::1"], 8000)
    page = Page(feed, own, commands, TOKEN, run_dir=run_dir)  # type: ignore[arg-type]
    return TestClient(page.application(), base_url=f"http://{HOST}")


def command(commands: Commands | None, body: Any = None, **headers: str) -> httpx.Response:
    sent = GOOD | {name.replace("_", "-"): value for name, value in headers.items()}
    sent = {name: value for name, value in sent.items() if value}
    content = json.dumps({"act": "pause"} if body is None else body)
    return client(commands).post("/commands", content=content, headers=sent)


def test_modules_have_the_type_that_browsers_demand() -> None:
    for path in ("/static/main.mjs", "/static/vendor/d3-zoom.min.mjs"):
        answer = client(None).get(path)
        assert answer.status_code == 200
        assert answer.headers["content-type"].startswith("text/javascript")


def test_the_policy_lets_in_the_pages_own_files_alone() -> None:
    answer = client(None).get("/")
    policy = answer.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "http" not in policy
    (inline,) = re.findall(rb"<script[^>]*>(.+?)</script>", answer.content, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(inline).digest()).decode()
    assert f"script-src 'self' 'sha256-{digest}'" in policy
    assert not re.search(rb"\son\w+=|style=", answer.content)


def test_every_answer_has_the_headers() -> None:
    for path in ("/", "/mission", "/static/style.css", "/nothing", "/static/../app.py"):
        headers = client(None).get(path).headers
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
        assert "access-control-allow-origin" not in headers


def test_mission_why_and_trees() -> None:
    page = client(None)
    told = page.get("/mission").json()
    assert (told["control"], told["recording"]) == (None, None)
    assert page.post("/playback", content="{}", headers=GOOD).status_code == 404
    assert page.get("/why/robot/A").json()["sentence"].startswith("A does weld")
    assert "weld" in page.get("/why/task/weld").json()["sentence"]
    assert page.get("/trees/A").json()["T_Li"]["statuses"][0] == 1
    assert page.get("/why/robot/A").json()["next"] == []
    for path in ("/why/robot/Z", "/why/task/none", "/why/job/none", "/trees/Z"):
        assert page.get(path).status_code == 404


def test_commands_for_a_run_that_is_over(tmp_path: Path) -> None:
    assert client(None).get("/mission").json()["commands"] == {}
    report = {"make a report": f"mrbt recording report {tmp_path}"}
    assert client(None, tmp_path).get("/mission").json()["commands"] == report
    (tmp_path / "run.mcap").touch()
    replay = {"see it again": f"mrbt recording replay {tmp_path}/run.mcap --web"}
    assert client(None, tmp_path).get("/mission").json()["commands"] == replay | report


@pytest.mark.parametrize("host", ["evil.example:8000", "127.0.0.1", "127.0.0.1:8001", "", "[::1]"])
def test_another_name_is_refused(host: str) -> None:
    """A name that an attacker has resolve to this machine is not one of ours."""
    answer = client(None).get("/mission", headers={"host": host})
    assert answer.status_code == 421
    assert "vehicle" not in answer.text


@pytest.mark.parametrize("host", ["localhost:8000", "LOCALHOST:8000", "[::1]:8000"])
def test_names_of_loopback_are_ours(host: str) -> None:
    assert client(None).get("/mission", headers={"host": host}).status_code == 200


def test_the_teams_metrics_are_served_beside_the_page() -> None:
    page = client(None)
    precise = page.get("/metrics", headers={"accept": "application/openmetrics-text"})
    assert precise.headers["content-type"].startswith("application/openmetrics-text")
    plain = page.get("/metrics")
    assert plain.headers["content-type"].startswith("text/plain")
    for found in (parse_openmetrics(precise.text), parse_text(plain.text)):
        values = {(s.name, *s.labels.values()): s.value for f in found for s in f.samples}
        assert values["mrbt_team_robots", "alive"] == 2
        working = [value for name, value in values.items() if name[0] == "mrbt_team_robot_working"]
        assert working == [1]
        assert values["mrbt_team_agreement",] == 1


def test_metrics_are_for_this_host_and_no_other_site() -> None:
    page = client(None)
    assert page.get("/metrics", headers={"host": "evil.example:8000"}).status_code == 421
    assert page.get("/metrics", headers={"sec-fetch-site": "cross-site"}).status_code == 403


def test_metrics_without_the_extra_say_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "prometheus_client", None)
    answer = client(None).get("/metrics")
    assert answer.status_code == 501
    assert "pip install 'mrbt-mesh[metrics]'" in answer.text


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_other_sites_may_link_to_the_page_and_read_nothing(site: str) -> None:
    page, headers = client(None), {"sec-fetch-site": site}
    assert page.get("/", headers=headers).status_code == 200
    assert page.get("/mission", headers=headers).status_code == 403
    assert page.get("/events", headers=headers).status_code == 403


def test_a_command_from_the_page(commands: Commands) -> None:
    headers = {"sec_fetch_site": "same-origin", "origin": f"http://{HOST}"}
    answer = command(commands, {"act": "kill", "robot": "A"}, **headers)
    assert answer.json() == {"done": True, "text": "done"}
    assert commands.taken == [{"act": "kill", "robot": "A"}]


@pytest.mark.parametrize(
    "headers",
    [
        {"x_mrbt_token": ""},
        {"x_mrbt_token": "another"},
        {"x_mrbt_token": TOKEN + "x"},
        {"origin": "http://evil.example"},
        {"origin": "null"},
        {"origin": f"https://{HOST}"},
        {"sec_fetch_site": "cross-site"},
        {"sec_fetch_site": "same-site"},
        {"content_type": "text/plain"},
        {"content_type": "application/x-www-form-urlencoded"},
    ],
)
def test_commands_from_elsewhere_are_refused(commands: Commands, headers: dict[str, str]) -> None:
    assert command(commands, **headers).status_code in (403, 415)
    assert commands.taken == []


def test_without_control_nothing_is_taken() -> None:
    assert command(None).status_code == 403
    assert client(None).get("/drills", headers=GOOD).status_code == 403


def test_drills_are_listed_for_those_who_may(commands: Commands) -> None:
    page = client(commands)
    assert page.get("/drills", headers=GOOD).json() == [{"label": "one"}]
    assert page.get("/drills").status_code == 403
    assert page.get("/commands", headers=GOOD).status_code == 405


def test_why_no_drills_can_be_listed(commands: Commands) -> None:
    commands.problem = "wrong.yaml: line 1"
    answer = client(commands).get("/drills", headers=GOOD)
    assert (answer.status_code, answer.text) == (409, "wrong.yaml: line 1")


def test_what_is_no_command(commands: Commands) -> None:
    assert command(commands, "wrong").json() == {"done": False, "text": "no such command"}
    assert client(commands).post("/commands", content="{", headers=GOOD).status_code == 400
    assert client(commands).post("/commands", content="[" * 4_000, headers=GOOD).status_code == 400
    assert client(commands).post("/commands", content=" " * 5_000, headers=GOOD).status_code == 413


def test_nothing_outside_of_the_folder_is_served() -> None:
    assert (STATIC.parent / "app.py").is_file()
    for path in ("/static/../app.py", "/static/%2e%2e/app.py", "/static/vendor/../../app.py"):
        assert client(None).get(path).status_code in (404, 400)
