"""Robots that stop without an operator, as real processes."""

from __future__ import annotations

from tests.support.paths import ROOT
from tests.support.team import EXPLORE, Team

WITHOUT = "no contact with an operator"


def test_robots_work_while_an_operator_attends(team: Team) -> None:
    text = EXPLORE.read_text()
    line = "    capabilities: {explore: 1}\n"
    assert line in text
    policy = "    on_lost_contact: {after_s: 2, of: operator, then: hold}\n"
    text = text.replace(line, line + policy)
    text = text.replace("../../agents/", f"{ROOT}/agents/")
    mission = team.folder / "mission.yaml"
    mission.write_text(text)
    team.hold("explore")
    team.up(mission)
    team.wait_until(lambda: len(team.robots()) == 2, "both are there")

    def reasons() -> list[set[str]]:
        return [set(robot["pending"].values()) for robot in team.status()["robots"].values()]

    team.wait_until(lambda: reasons() == [{WITHOUT}] * 2, "both hold")
    assert not team.events(), "nobody has begun"
    operator = team.start("attend", "--run-dir", str(team.run_dir))
    team.wait_for_events(2, "explore")
    operator.kill()
    operator.wait()
    team.wait_for_events(2, "explore", "cancel")
    team.wait_until(lambda: reasons() == [{WITHOUT}] * 2, "both hold")
    again = team.start("attend", "--run-dir", str(team.run_dir))
    team.release()
    assert team.end()[0] == 0, team.logs()
    again.kill()
