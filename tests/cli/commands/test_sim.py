"""`mrbt sim run`: exit statuses, the summary as JSON and for people, replays, what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.support.command import EXPLORE, REPAIR, done, mrbt, refused
from tests.support.paths import ROOT


def sim(*arguments: str) -> tuple[int, str, str]:
    return mrbt("sim", "run", *arguments)


def test_success_as_json() -> None:
    summary = json.loads(done(sim(REPAIR, "--seed", "3", "--kill", "A1@6,B2@12", "--json")))
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
    assert sim(*arguments) == sim(*arguments)


def test_works_vary_with_noise_and_the_same_seed_prints_the_same() -> None:
    first, again, exact = (
        json.loads(done(sim(EXPLORE, "--json", *noise)))
        for noise in (("--noise", "0.3"), ("--noise", "0.3"), ())
    )
    assert first == again
    assert 0 < abs(first["duration_s"] / exact["duration_s"] - 1) < 0.35


def test_the_summary_for_people_tells_the_story() -> None:
    schedule = ("--kill", "C1@1", "--restart", "C1@5", "--fault", "A1:replace_hw@2")
    text = " ".join(done(sim(REPAIR, *schedule, "--restore", "A1@3", "--kill", "A2@9")).split())
    assert "mission succeeded" in text
    assert "remove_cover blocked: move_frame needs 2, 1 alive, until" in text
    assert "A1 lost replace_hw: injected; had it again at" in text
    assert "C1 died" in text
    assert "replaced by A1" in text


@pytest.mark.slow
def test_a_robot_that_does_something_worse_hands_it_on() -> None:
    """In the example robots of type A replace hardware best."""

    def who(*arguments: str) -> list[str]:
        summary = json.loads(done(sim(REPAIR, "--seed", "3", "--json", *arguments)))
        told = summary["robots"]["A1"]["performances"]
        assert told == ({"replace_hw": 0.5} if arguments else {})
        return sorted(
            {
                r
                for n, t in summary["global_tasks"].items()
                for r in t["robots"]
                if n.startswith("fix_hw")
            }
        )

    assert who() == ["A1", "A2"]
    worse = ("--performance", "A1:replace_hw=0.5@2,A2:replace_hw=0.5@2")
    assert who(*worse) == ["B1", "B2"]


def test_a_failed_mission_exits_1(tmp_path: Path) -> None:
    mission = (ROOT / "examples" / "tool_search" / "mission.yaml").read_text(encoding="utf-8")
    program = ROOT / "agents" / "tool_search.py"
    mission = mission.replace("../../agents/tool_search.py", str(program))
    mission = mission.replace("tools_in_storage: 2", "tools_in_storage: 3")
    file = tmp_path / "mission.yaml"
    file.write_text(mission, encoding="utf-8")
    code, output, problems = sim(str(file))
    assert code == 1, problems
    assert "mission failed" in output


def test_a_blocked_mission_exits_3() -> None:
    code, output, _ = sim(REPAIR, "--kill", "C1@1", "--timeout", "8", "--json")
    assert code == 3
    assert json.loads(output)["result"] == "blocked"


def test_an_endless_mission_exits_3_when_its_time_is_up(tmp_path: Path) -> None:
    mission = (ROOT / "examples" / "explore" / "mission.yaml").read_text(encoding="utf-8")
    program = ROOT / "agents" / "explore.py"
    mission = mission.replace("../../agents/explore.py", str(program))
    start = mission.index("tree:")
    file = tmp_path / "mission.yaml"
    tree = "tree: {Repeat: {cycles: -1, do: explore_area(A)}}\n"
    file.write_text(mission[:start] + tree, encoding="utf-8")
    code, output, problems = sim(str(file), "--timeout", "60", "--json")
    assert (code, problems) == (3, "")
    assert json.loads(output)["result"] == "timeout"


def test_files_are_written(tmp_path: Path) -> None:
    events, log = tmp_path / "events.jsonl", tmp_path / "log.txt"
    assert sim(EXPLORE, "--events", str(events), "--log", str(log))[0] == 0
    lines = [json.loads(line) for line in events.read_text().splitlines()]
    assert {line["event"] for line in lines} == {"start", "end"}
    assert {line["robot"] for line in lines} == {"R1", "R2"}
    keys = {"t", "robot", "pid", "incarnation", "event", "outcome", "activation", "global_task"}
    assert keys | {"local_task", "args"} == lines[0].keys()
    assert '"StartAction"' in log.read_text()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--kill", "A1:replace_hw@4"], "only --fault, --restore, --performance name a local task"),
        (["--performance", "A1:replace_hw@4"], "of which local task? e.g. A1:LOCAL_TASK=0.5@4"),
        (["--performance", "A1:all=1@4"], "of which local task?"),
        (["--performance", "A1:fly=1@4"], "A1 has no local task 'fly'"),
        (["--performance", "A1:replace_hw=-1@4"], "from 0 to 1000000 expected, found '-1'"),
        (["--performance", "A1:replace_hw=inf@4"], "from 0 to 1000000 expected, found 'inf'"),
        (["--fault", "A1@4"], "which local task? e.g. A1:all@4"),
        (["--restore", "A1:@4"], "which local task? e.g. A1:all@4"),
        (["--kill", "A1@2"], "--kill A1@2: the run is given up at 1 s; give it a longer timeout"),
        (["--kill", "A1@0.2", "--freeze", "A1@0.4"], "A1 does not run at that time"),
        (["--leave", "A1@0.2", "--fault", "A1:all@0.4"], "A1 does not run at that time"),
        (["--robots", "B1,C1,C2", "--kill", "A1@0.5"], "A1 does not run at that time"),
        (["--freeze", "A1@0.1,A1@0.3", "--restart", "A1@0.5", "--thaw", "A1@0.6"], "not frozen"),
        (["--loss", "0.0004"], "in steps of 0.001"),
        (["--delay-ms", "-1"], "'--delay-ms': -1.0 is not in the range x>=0"),
        (["--delay-ms", "0.0001"], "in steps of 0.001"),
        (["--robots", "A1,"], "has no robot ''"),
        (["--speed", "0"], "0.01<=x<=1000"),
        (["--speed", "inf"], "0.01<=x<=1000"),
        (
            ["--events", "/nonexistent/x"],
            "--events /nonexistent/x: there is no folder /nonexistent",
        ),
        (["--log", "/"], "--log /: is a folder; name a file"),
    ],
)
def test_bad_input_exits_2_and_says_what_would_be_right(arguments: list[str], message: str) -> None:
    assert message in " ".join(refused(sim(REPAIR, "--timeout", "1", *arguments)).split())


def test_what_was_asked_for_after_the_end_is_said_to_have_been_in_vain() -> None:
    code, output, problems = sim(EXPLORE, "--kill", "R1@400", "--json")
    assert code == 0
    ended_s = json.loads(output)["duration_s"]
    assert problems.startswith("note: --kill R1@400: the run had ended before, at ")
    assert float(problems.split()[-2]) == pytest.approx(ended_s, abs=0.5)


def test_faults_may_follow_one_another() -> None:
    said = ("--freeze", "R1@1", "--thaw", "R1@2", "--kill", "R1@2.5", "--restart", "R1@3")
    code, output, problems = sim(EXPLORE, "--robots", "R1", *said, "--restart", "R2@4", "--json")
    assert (code, problems) == (0, "")
    assert json.loads(output)["robots"].keys() == {"R1", "R2"}, "R2 was started as one more"


# -- replays --------------------------------------------------------------------------------------

SCHEDULE = {"seed": 1, "robots": ["R1"], "steps": [], "heal_us": 1, "timeout_us": 2_000_000}


def written(tmp_path: Path, **more: Any) -> str:
    path = tmp_path / "schedule.json"
    path.write_text(json.dumps({**SCHEDULE, **more}))
    return str(path)


def test_a_schedule_is_replayed(tmp_path: Path) -> None:
    steps = [
        [1_000_000, {"fault": "Kill", "robot": "R1"}],
        [3_000_000, {"fault": "Heal", "robots": ["R1"]}],
    ]
    times = {"heal_us": 3_000_000, "timeout_us": 60_000_000}
    more = {"robots": ["R1", "R2"], "steps": steps, **times}
    code, output, problems = sim("--schedule", written(tmp_path, mission=EXPLORE, **more))
    assert (code, problems) == (0, "")
    assert "R1 died" in output
    assert "was back at" in output


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[", "Expecting value"),
        ("[]", "an object with mission, seed, robots, steps is expected"),
        ('{"seed": 1, "robots": ["R1"], "steps": [], "heal_us": 1}', "'timeout_us' is missing"),
        (json.dumps(SCHEDULE), "names no mission; give one"),
        (json.dumps({**SCHEDULE, "robots": []}), "robots: at least one is expected"),
        (json.dumps({**SCHEDULE, "speed": 0}), "speed: a number above 0 is expected"),
        (json.dumps({**SCHEDULE, "speed": float("nan")}), "speed: a number expected, not nan"),
        (json.dumps({**SCHEDULE, "timeout_us": 0}), "timeout_us is above 0"),
    ],
)
def test_a_bad_schedule_file_exits_2(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "schedule.json"
    path.write_text(text)
    assert message in refused(sim("--schedule", str(path)))


@pytest.mark.parametrize(
    "more",
    [
        {"robots": ["Z"]},
        {"steps": [[1, {"fault": "Kill", "robot": "Z"}]]},
        {"steps": [[1, {"fault": "Block", "links": [["R1", "Z"]]}]]},
        {"steps": [[1, {"fault": "Heal", "robots": ["Z"]}]]},
        {"steps": [[1, {"fault": "Replay", "robot": "R1", "source": "Z", "until_us": 1}]]},
    ],
)
def test_a_schedule_of_robots_that_the_mission_lacks_exits_2(
    tmp_path: Path, more: dict[str, Any]
) -> None:
    problems = refused(sim(EXPLORE, "--schedule", written(tmp_path, **more)))
    assert "mission explore has no robot Z" in problems


@pytest.mark.parametrize(
    "option",
    [
        ["--seed", "0"],
        ["--robots", "R1"],
        ["--solver", "cp_sat"],
        ["--timeout", "600"],
        ["--speed", "1"],
        ["--kill", "R1@1"],
        ["--loss", "0"],
        ["--delay-ms", "1"],
    ],
)
def test_what_a_schedule_says_cannot_be_said_beside_it(tmp_path: Path, option: list[str]) -> None:
    """Not even with the value that is the default."""
    problems = refused(sim(EXPLORE, "--schedule", written(tmp_path), *option))
    assert f"{option[0]}: not with --schedule, whose file has it" in problems


def test_without_a_mission_and_a_schedule_there_is_nothing_to_run() -> None:
    assert "give a MISSION, or the --schedule of a run to repeat" in refused(sim())
    assert "cannot be read: No such file" in refused(sim("--schedule", "/nonexistent.json"))
