"""`mrbt sim`: exit statuses, the summary as JSON and for people, messages for bad input."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import typer
from click.testing import Result
from typer.testing import CliRunner

from mrbt_mesh.cli.sim import sim
from tests.support.runs import EXAMPLES

REPAIR = str(EXAMPLES / "vehicle_repair" / "mission.yaml")
EXPLORE = str(EXAMPLES / "explore" / "mission.yaml")


def mrbt_sim(*arguments: str) -> Result:
    app = typer.Typer(pretty_exceptions_enable=False)
    app.command("sim")(sim)
    return CliRunner().invoke(app, list(arguments))


def test_success_as_json() -> None:
    result = mrbt_sim(REPAIR, "--seed", "3", "--kill", "A1@6,B2@12", "--json")
    assert result.exit_code == 0, result.output
    summary = json.loads(result.stdout)
    assert summary["result"] == "success"
    assert summary["seed"] == 3
    assert len(summary["effect_log_digest"]) == 32
    assert summary["violations"] == []
    assert [fault["robot"] for fault in summary["faults"]] == ["A1", "B2"]
    assert summary["global_tasks"]["remove_screws"]["status"] == "success"
    keys = {"result", "duration_s", "robots", "global_tasks", "faults", "blocked", "takeovers"}
    assert keys <= summary.keys()


def test_the_same_seed_prints_the_same() -> None:
    arguments = (EXPLORE, "--seed", "5", "--loss", "0.1", "--jitter-ms", "4", "--json")
    first, second = mrbt_sim(*arguments), mrbt_sim(*arguments)
    assert first.stdout == second.stdout


def test_the_summary_for_people_tells_the_story() -> None:
    schedule = ("--kill", "C1@1", "--restart", "C1@5", "--fault", "A1:replace_hw@2")
    result = mrbt_sim(REPAIR, *schedule, "--restore", "A1@3", "--kill", "A2@9")
    assert result.exit_code == 0, result.output
    text = " ".join(result.stdout.split())
    assert "mission succeeded" in text
    assert "remove_cover blocked: move_frame needs 2, 1 alive, until" in text
    assert "A1 lost replace_hw; had it again at" in text
    assert "C1 died" in text
    assert "replaced by A1" in text


def test_a_failed_mission_exits_1(tmp_path: Path) -> None:
    mission = (EXAMPLES / "tool_search" / "mission.yaml").read_text(encoding="utf-8")
    program = EXAMPLES.parent / "agents" / "tool_search.py"
    mission = mission.replace("../../agents/tool_search.py", str(program))
    mission = mission.replace("tools_in_storage: 2", "tools_in_storage: 3")
    file = tmp_path / "mission.yaml"
    file.write_text(mission, encoding="utf-8")
    result = mrbt_sim(str(file))
    assert result.exit_code == 1, result.output
    assert "mission failed" in result.stdout


def test_a_blocked_mission_exits_3() -> None:
    result = mrbt_sim(REPAIR, "--kill", "C1@1", "--timeout", "8", "--json")
    assert result.exit_code == 3
    assert json.loads(result.stdout)["result"] == "blocked"


def test_files_are_written(tmp_path: Path) -> None:
    events, log = tmp_path / "events.jsonl", tmp_path / "log.txt"
    assert mrbt_sim(EXPLORE, "--events", str(events), "--log", str(log)).exit_code == 0
    lines = [json.loads(line) for line in events.read_text().splitlines()]
    assert {line["event"] for line in lines} == {"start", "end"}
    assert {line["robot"] for line in lines} == {"R1", "R2"}
    keys = {"t", "robot", "pid", "incarnation", "event", "outcome", "activation", "global_task"}
    assert keys | {"local_task", "args"} == lines[0].keys()
    assert '"StartAction"' in log.read_text()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--kill", "Z9@1"], "no robot 'Z9' (A1, A2, B1, B2, C1, C2)"),
        (["--kill", "A1"], "expected ROBOT@SECONDS, e.g. A1@12.5"),
        (["--kill", "A1@-4"], "expected ROBOT@SECONDS, e.g. A1@12.5"),
        (["--kill", "A1:replace_hw@4"], "only --fault and --restore name a task"),
        (["--fault", "A1@4"], "which local task? e.g. A1:all@4"),
        (["--fault", "A1:fly@4"], "A1 has no local task 'fly'"),
        (["--loss", "1.5"], "--loss 1.5: a chance is from 0 to 1"),
        (["--delay-ms", "-1"], "--delay-ms and --jitter-ms are 0 or more"),
        (["--robots", "A1,Q"], "has no robot Q"),
        (["--speed", "0"], "--timeout and --speed are above 0"),
        (["--program", "nothing.py"], "there is no such file"),
        (["--events", "/nonexistent/x"], "cannot be written: No such file or directory"),
    ],
)
def test_bad_input_exits_2_and_says_what_would_be_right(arguments: list[str], message: str) -> None:
    result = mrbt_sim(REPAIR, "--timeout", "1", *arguments)
    assert result.exit_code == 2, result.output
    assert message in " ".join(result.stderr.split())
    assert "Traceback" not in result.output


def test_a_mission_that_cannot_be_read_exits_2(tmp_path: Path) -> None:
    result = mrbt_sim(str(tmp_path / "none.yaml"))
    assert result.exit_code == 2
    assert "there is no such file" in " ".join(result.stderr.split())


def test_help_has_an_example() -> None:
    result = mrbt_sim("--help")
    assert result.exit_code == 0
    assert "mrbt sim examples/vehicle_repair/mission.yaml" in " ".join(result.stdout.split())
