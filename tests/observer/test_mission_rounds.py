"""The rounds of a mission that never ends, as an observer of a team of agents tells them."""

from __future__ import annotations

from typing import Any

import pytest

from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.observer.mission_rounds import MissionRounds
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.observer.summary import run_summary
from tests.support.script import Script

SUCCESS, FAILURE = Status.SUCCESS, Status.FAILURE
TEAM = ["ends never", "robot A weld", "robot B weld*0.5", 'tree Fallback("?nominal", "weld")']


def watched(*commands: str) -> tuple[Script, Observer]:
    script = Script()
    script.block([*TEAM, "observe", "start A B exit_when_done", "pass 200", *commands])
    observer = script.team.observer
    assert observer is not None
    return script, observer


def rounds(script: Script, observer: Observer) -> list[dict[str, Any]]:
    summary = run_summary(observer, observer.result(True), script.team.now_us)
    assert summary["ends"] == "never"
    found: list[dict[str, Any]] = summary["rounds"]
    return found


def test_each_round_is_told_with_its_times_its_result_and_who_took_part() -> None:
    script, observer = watched("succeed A nominal=true", "pass 1000")
    (first,) = rounds(script, observer)
    assert (first["result"], first["robots"]) == ("success", ["A"])
    assert first["from_s"] < 0.2 <= first["to_s"] < 0.3
    script.block(["set B nominal=false", "pass 500"])
    assert rounds(script, observer)[1] == {
        "from_s": pytest.approx(1.2, abs=0.05),
        "to_s": None,
        "duration_s": pytest.approx(0.5, abs=0.05),
        "result": None,
        "robots": ["A"],
    }
    script.block(["fail A", "pass 100", "fail B", "pass 300"])
    _, second = rounds(script, observer)
    assert (second["result"], second["robots"]) == ("failure", ["A", "B"])
    assert second["duration_s"] == pytest.approx(0.6, abs=0.05)
    told = [text for _, text in observer.record.timeline if text.startswith("round")]
    assert told[:3] == ["round 1 begins", "round 1: success after 0.2 s", "round 2 begins"]


@pytest.mark.parametrize(
    ("steps", "result"),
    [
        ((), "timeout"),
        (("succeed A nominal=true", "pass 200"), "success"),
        (("set A nominal=true", "pass 200"), "success"),
        (("fail A", "pass 100", "fail B", "pass 200"), "failure"),
        # One that is on its way counts for nothing, unless it is blocked.
        (("succeed A nominal=true", "pass 200", "set B nominal=false", "pass 200"), "success"),
        (
            (
                *("succeed A nominal=true", "pass 200", "tell A fault all", "tell B fault all"),
                *("set B nominal=false", "pass 500"),
            ),
            "blocked",
        ),
        (("succeed A nominal=true", "pass 200", "operate A aborted true", "pass 500"), "failure"),
    ],
)
def test_the_last_round_that_has_ended_is_the_result(steps: tuple[str, ...], result: str) -> None:
    _, observer = watched(*steps)
    assert observer.result(anybody_lives=True) == result


def test_a_team_that_is_gone_stands_by_no_more() -> None:
    _, observer = watched("succeed A nominal=true", "pass 200")
    assert observer.result(anybody_lives=False) == "blocked"


def test_faults_while_it_stands_by_are_told() -> None:
    script, observer = watched("succeed A nominal=true", "pass 300", "kill B", "pass 1500")
    assert [fault.robot for fault in observer.record.major] == ["B"]
    assert len(rounds(script, observer)) == 1


def test_standing_by_from_the_beginning_is_no_round() -> None:
    log = MissionRounds()
    assert log.ended(SUCCESS, 1) is None
    assert log.ended(SUCCESS, 2) is None
    assert (list(log.all), log.result) == ([], SUCCESS)
    log.running(3)
    assert log.result is None, "the first round has only begun"


def test_a_result_that_turns_without_work_is_a_round() -> None:
    log = MissionRounds()
    log.ended(SUCCESS, 1)
    turned = log.ended(FAILURE, 5)
    assert turned is not None
    assert (turned.from_us, turned.to_us, turned.result) == (5, 5, FAILURE)
    assert log.running(7)
    assert not log.running(8)
    assert log.result is FAILURE
    ended = log.ended(FAILURE, 9)
    assert ended is not None
    assert (ended.from_us, ended.to_us, ended.result) == (7, 9, FAILURE)
    assert log.current is None
