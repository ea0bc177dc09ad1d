"""One death has one number: everything that shows it reads the record of who launched the run."""

from __future__ import annotations

import json
import re

import pytest

from mrbt_mesh.cli.watching import BATCH_S
from mrbt_mesh.observer.episodes import after_text
from mrbt_mesh.observer.headline import headline
from mrbt_mesh.observer.summary import run_summary
from mrbt_mesh.recording.folder import observer_file
from mrbt_mesh.recording.player import Player
from mrbt_mesh.recording.reader import read_recording
from mrbt_mesh.views.model.team_view import TeamView
from tests.support.served import free_ports, page
from tests.support.team import Team
from tests.support.terminal import Terminal


@pytest.mark.smoke
def test_all_views_show_the_same_times_of_a_death(team: Team) -> None:
    port = free_ports(1)
    team.hold("replace_hw")
    team.up()
    victim = team.wait_for_work(team.wait_for_event("replace_hw"))
    watch = team.start("watch", "--headless", "--metrics-port", str(port))
    watched = f"127.0.0.1:{port}"
    team.wait_until(lambda: page(watched).get(("mrbt_team_observer_caught_up",)), "it is watched")
    with Terminal("watch", "--top", environment=team.environment) as terminal:
        terminal.wait_for(rf"{victim['robot']} ● ")
        team.mrbt("kill", victim["robot"])
        team.wait_for_replacement(victim)
        team.wait_for_line(f"{victim['robot']} is dead")

        def deaths() -> list[dict[str, object]]:
            path = team.run_dir / "deaths.json"
            rows = json.loads(path.read_text())["deaths"] if path.exists() else []
            return [row for row in rows if row["reassigned_after_us"] is not None and row["exact"]]

        (death,) = team.wait_until(deaths, "the launcher has written the times")
        detected_us, taken_us = death["detected_after_us"], death["reassigned_after_us"]
        detected, taken = after_text(detected_us, True), after_text(taken_us, True)
        replacement = str(death["replacement"])
        terminal.wait_for(re.escape(f"{replacement} took over after {taken}"))
        metric = "mrbt_team_takeover_duration_seconds_sum"
        team.wait_until(lambda: page(watched).get((metric,)) == taken_us / 1e6, "the metric")
        assert page(watched)["mrbt_team_detection_duration_seconds_sum",] == detected_us / 1e6
        terminal.press("q")
    team.release()
    code, summary = team.end()
    assert code == 0
    (takeover,) = summary["takeovers"]
    assert (takeover["detected_s"], takeover["reassigned_s"]) == (detected_us / 1e6, taken_us / 1e6)
    assert takeover["exact"]
    assert f"replaced by {replacement} after {taken}" in " ".join(team.lines().split())
    said, _ = watch.communicate(timeout=60)
    assert f"replaced by {replacement} after {taken}" in " ".join(said.split())

    player = Player(read_recording(observer_file(team.run_dir)))
    player.seek(player.end_us)
    replayed = run_summary(player.observer, "success", player.end_us)
    (again,) = replayed["takeovers"]
    # The replay's run begins with the first robot that has joined, by another one's word if that
    # came first: messages of a burst are taken in together, the later the busier the computer is.
    later_s = abs(replayed["duration_s"] - summary["duration_s"]) + 2 * BATCH_S
    assert again == takeover | {"at_s": pytest.approx(takeover["at_s"], abs=later_s)}
    texts = [statement.text for statement in headline(player.observer, (), 0)]
    assert any(text.endswith(f"replaced by {replacement} after {taken}") for text in texts), texts
    view = TeamView(player.observer)
    view.update(player.end_us)
    items = view.changes.since(0)
    item = items["fault/0"]
    assert (item["detected_after"], item["taken_over_after"]) == (detected, taken)
    assert f"took over its {item['held']} after {taken}." in items["why/0"]["sentence"]

    (run,) = json.loads(team.mrbt("recording", "report", "--json"))["runs"]
    assert [(each["by"], each["command"][:2]) for each in run["commands"]] == [
        ("mrbt kill", victim["robot"])
    ]
    assert run["proof"]["findings"] == []
    (fault,) = run["faults"]
    assert (fault["detected_us"], fault["taken_over_us"]) == (detected_us, taken_us)
