"""A team as a page sees it: held against what the observer and the robots say themselves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.core.facts.store import Incarnation, Version, make_entry
from mrbt_mesh.core.mission.compiled import compile_mission
from mrbt_mesh.features.revisions.records import HeldMission
from mrbt_mesh.features.revisions.revise import revise
from mrbt_mesh.observer.job_log import JobHistory
from mrbt_mesh.observer.job_rows import JobRow
from mrbt_mesh.observer.summary import run_summary
from mrbt_mesh.recording.folder import observer_files
from mrbt_mesh.recording.player import Player
from mrbt_mesh.recording.reader import read_recording
from mrbt_mesh.sim import simulate
from mrbt_mesh.views.model.team_view import TeamView, since_us
from tests.support.commands import command
from tests.support.depot import depot, worker
from tests.support.runs import run_example
from tests.support.watched import COVER, WELD, watched


class Page:
    """What a page holds that asks after every command."""

    def __init__(self, *commands: str) -> None:
        self.script, self.observer = watched(COVER)
        self.view = TeamView(self.observer)
        self.items: dict[str, Any] = {}
        self._seen = 0
        self.look()
        self.do(*commands)

    def do(self, *commands: str) -> None:
        for line in commands:
            self.script.block([line])
            self.look()

    def look(self) -> None:
        self.view.update(self.script.team.now_us)
        self.items |= self.view.changes.since(self._seen)
        self._seen = self.view.changes.version


def test_who_works_where_and_how_nodes_stand() -> None:
    page = Page()
    assert page.items["robot/A"]["local_task"] == "weld"
    assert page.items["robot/A"]["phase"] == "running"
    assert page.items["robot/C"]["idle"] == "nothing it can do is needed now"
    assert page.items["node/0"] == [1, [], "", 0]
    assert page.items["node/1"] == [1, ["A"], "", 1]
    assert "node/2" not in page.items, "not ticked yet"
    page.do("succeed A", "pass 300")
    assert page.items["node/1"] == [2, [], "", 1]
    assert page.items["node/2"] == [1, ["A", "B"], "", 1]
    assert page.items["task/weld"]["state"] == "success"
    assert page.items["task/weld"]["took_part"] == ["A"]


def test_all_agree() -> None:
    page = Page()
    assert page.items["headline"][-1] == {"level": "good", "text": "all 3 agree"}


def test_statuses_are_those_of_the_heartbeats() -> None:
    page = Page()
    assert page.items["robot/A"]["statuses"] == ["running", "success", "running", "running"]
    page.do("kill A", "pass 1500")
    assert page.items["robot/A"]["statuses"] == []


def test_a_kill_its_detection_and_the_takeover() -> None:
    page = Page("kill A", "pass 300")
    (told,) = run_summary(page.observer, "", page.script.team.now_us)["takeovers"]
    fault = page.items["fault/0"]
    assert (fault["robot"], fault["held"], fault["replacement"]) == ("A", "weld", "B")
    assert fault["at_s"] == told["at_s"]
    assert fault["detected_ms"] == pytest.approx(told["detected_s"] * 1e3, abs=0.1)
    assert fault["taken_over_ms"] == pytest.approx(told["reassigned_s"] * 1e3, abs=0.1)
    assert page.items["robot/A"]["state"] == "dead"
    why = page.items["why/0"]
    about = f"after {fault['taken_over_after']}, as seen by the observer."
    assert f"B took over its weld {about}" in why["sentence"]
    chosen, dead, *_ = why["groups"][0]["candidates"]
    assert (chosen["robot"], chosen["reason"], chosen["chosen"]) == ("B", "has taken over", True)
    assert (dead["robot"], dead["reason"], dead["chosen"]) == ("A", "is dead", False)


def test_work_of_the_dead_ends_with_them() -> None:
    page = Page("kill A", "pass 300", "succeed B", "pass 100")
    first, second = page.items["work/0"], page.items["work/1"]
    assert (first["robot"], first["end"]) == ("A", "died")
    assert first["ended_s"] == page.items["fault/0"]["at_s"]
    assert (second["robot"], second["end"]) == ("B", "done")
    assert second["running_s"] >= first["ended_s"]


def test_a_blocked_task_says_so_and_why() -> None:
    page = Page("succeed A", "kill B", "pass 1500")
    assert page.items["task/cover"]["reason"] == "blocked: lift needs 2, 1 alive"
    assert page.items["node/2"][2] == "blocked"
    assert page.items["headline"][0]["text"].startswith("BLOCKED: cover")
    page.do("start B", "pass 1500")
    assert all(each["level"] != "bad" for each in page.items["headline"])


def test_robots_that_end_with_the_run_have_not_died() -> None:
    script, observer = watched(
        COVER, "kill C", "pass 1500", "succeed A", "pass 300", "succeed A", "succeed B"
    )
    script.block(["pass 300", "kill A", "kill B", "pass 1500"])
    view = TeamView(observer)
    view.update(script.team.now_us)
    items = view.changes.since(0)
    assert items["team"]["ended"] == "success"
    states = [items[f"robot/{robot}"]["state"] for robot in ("A", "B", "C")]
    assert states == ["left", "left", "dead"]


def test_a_pending_revision_is_told_with_the_robots_that_it_waits_for() -> None:
    script, observer = watched(WELD)
    view = TeamView(observer)

    def team() -> Any:
        view.update(script.team.now_us)
        return view.changes.since(0)["team"]

    assert (team()["revision"], team()["pending"]) == (0, None)
    after = revise(observer.mission, observer.mission)
    proposed = command("mission/1", [compile_mission(after), False, False], operator="anna")
    observer.facts.map.merge([proposed])
    held = HeldMission(1, after.digest, "", 0)
    version = Version(Incarnation(9, "n"), 1)
    observer.facts.map.merge([make_entry("B", "mission_held", version, held)])
    assert team()["pending"] == {"number": 1, "by": "anna", "awaited": ["A"]}


def test_a_page_that_comes_late_has_the_whole_past() -> None:
    page = Page("kill A", "pass 300", "succeed B", "pass 300")
    assert page.view.changes.since(0) == {k: v for k, v in page.items.items() if v is not None}


def test_nothing_is_told_twice() -> None:
    page = Page("kill A", "pass 1000")
    version = page.view.changes.version
    assert not page.view.update(page.script.team.now_us)
    assert page.view.changes.version == version


def test_spans_of_a_run_are_what_the_robots_did() -> None:
    """The robots' own record of the run knows every start and end."""
    result = run_example("vehicle_repair", 3)
    view = TeamView(result.observer)
    view.update(result.duration_us)
    items = view.changes.since(0)
    spans = [item for key, item in items.items() if key.startswith("work/")]
    done = sorted((s["robot"], s["global_task"]) for s in spans if s["end"] == "done")
    ends = [event for event in result.events if event["outcome"] == "success"]
    assert done == sorted((event["robot"], event["global_task"]) for event in ends)
    assert len(done) > 10
    assert items["team"]["ended"] == "success"


def test_a_team_that_travels_has_a_forecast_until_its_end(tmp_path: Path) -> None:
    simulate(depot("Sequence: [scan_at(a), scan_at(b)]"), worker(), seed=1, record=tmp_path)
    player = Player(read_recording(observer_files(tmp_path)[0]))
    view, texts = TeamView(player.observer), []
    late: set[float] = set()
    for at_us in sorted({each.at_us for each in player.recording.records}):
        player.seek(at_us)
        view.update(at_us)
        found = view.changes.since(0).get("forecast")
        if found is None:
            continue
        texts.append(found["reason"])
        if not late and any(robot["goal"] for robot in found["robots"].values()):
            view.update(at_us + 60_000_000)
            robots = view.changes.since(0)["forecast"]["robots"].values()
            late = {robot["steps"][0]["begins_s"] for robot in robots if robot["goal"]}
    assert late == {0.0}, "what should have begun is expected at any moment"
    assert any(each.endswith("for makespan, 2 tasks") for each in texts), texts
    assert texts[-1] == "no schedule: no task ahead lacks robots, or the horizon is 1"
    assert "forecast" not in view.changes.since(0)


@pytest.mark.parametrize(
    ("state", "history", "since"),
    [
        ("waiting", JobHistory(submitted_us=5), 5),
        ("waiting", JobHistory(), None),
        ("waiting", JobHistory(submitted_us=5, begun_us=7, has_begun=True), None),
        ("running", JobHistory(submitted_us=5, begun_us=7, has_begun=True), 7),
        ("running", JobHistory(submitted_us=5, has_begun=True), None),
        ("held", JobHistory(submitted_us=5), None),
        (
            "succeeded",
            JobHistory(submitted_us=5, begun_us=7, ended_us=9, has_begun=True, has_ended=True),
            9,
        ),
        ("cancelled", None, None),
    ],
)
def test_a_job_that_was_there_before_the_view_has_its_true_time_or_none(
    state: str, history: JobHistory | None, since: int | None
) -> None:
    row = JobRow("a", "inspect", {}, state, "", 0, (), "anna")
    ended_us = history.ended_us if history is not None else None
    assert since_us(row, history, ended_us) == since
