"""Files for other programs, from a simulated run."""

from __future__ import annotations

import json
import socket
from pathlib import Path

import pytest

from mrbt_mesh.cli.plugged import exporting
from mrbt_mesh.plugins import VIEWS
from tests.support.command import EXPLORE, mrbt
from tests.support.groot2 import Desk, read_btlog

RUN = ("sim", "run", EXPLORE, "--seed", "3", "--speed", "20", "--json")


def test_a_simulated_run_in_both_formats(tmp_path: Path) -> None:
    log, lines = tmp_path / "run.btlog", tmp_path / "run.jsonl"
    plain = json.loads(mrbt(*RUN)[1])
    code, output, _ = mrbt(*RUN, "--btlog", str(log), "--py-trees-js", str(lines))
    assert (code, json.loads(output)) == (0, plain), "looking on changes nothing"
    found = read_btlog(log.read_bytes())
    assert found.began_unix_us == 0
    at_us, uid, status = found.changes[-1]
    last = json.loads(lines.read_text().splitlines()[-1])
    # The last change is that the mission succeeds, and both files tell it of the same moment.
    assert at_us <= last["timestamp"] * 1e6
    final = {}
    for _, uid, status in found.changes:
        final[uid] = status
    words = {0: "INVALID", 1: "RUNNING", 2: "SUCCESS", 3: "FAILURE"}
    for name, behaviour in last["behaviours"].items():
        assert words[final.get(int(name), 0)] == behaviour["status"]
    assert last["behaviours"]["1"]["status"] == "SUCCESS"


def test_the_same_run_writes_the_same_bytes(tmp_path: Path) -> None:
    files = [tmp_path / "one.btlog", tmp_path / "other.btlog"]
    for file in files:
        assert mrbt(*RUN, "--btlog", str(file))[0] == 0
    assert files[0].read_bytes() == files[1].read_bytes()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--btlog", "run.log"], "--btlog run.log: the name has to end in .btlog"),
        (["--btlog", "nowhere/x.btlog"], "--btlog nowhere/x.btlog: there is no folder nowhere"),
        (["--py-trees-js", "x.txt"], "--py-trees-js x.txt: the name has to end in .jsonl"),
    ],
)
def test_files_that_cannot_be_written_are_refused_at_once(words: list[str], message: str) -> None:
    for command in (RUN, ("watch", "--run-dir", "nowhere")):
        code, _, problems = mrbt(*command, *words)
        assert (code, message in problems) == (2, True), problems


def test_a_full_disk_ends_the_file_and_not_the_run(capsys: pytest.CaptureFixture[str]) -> None:
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("this system has no /dev/full")
    desk = Desk()
    with exporting({"py-trees-js": full}, desk.observer.mission, 0, 0) as look_on:
        for _ in range(3):
            desk.go("pass 300")
            look_on(desk.observer, desk.script.team.now_us)
        desk.go("set A done=true", "pass 300")
        look_on(desk.observer, desk.script.team.now_us)
    problems = capsys.readouterr().err
    assert problems.count("/dev/full: ends here: No space left on device") == 1


def test_of_a_schedule_files_are_written_too(tmp_path: Path) -> None:
    schedule = {"mission": str(EXPLORE), "seed": 1, "robots": ["R1"], "steps": []}
    schedule |= {"heal_us": 1, "timeout_us": 2_000_000}
    path, log = tmp_path / "schedule.json", tmp_path / "x.btlog"
    path.write_text(json.dumps(schedule))
    code, _, problems = mrbt("sim", "run", "--schedule", str(path), "--btlog", str(log))
    assert (code, problems) == (3, ""), "it is given up after two seconds"
    assert 0 < read_btlog(log.read_bytes()).changes[-1][0] <= 2_000_000


@pytest.mark.parametrize("view", [name for name in VIEWS.names() if name != "top"])
def test_a_view_that_cannot_listen_is_refused_before_robots_begin(
    view: str, tmp_path: Path
) -> None:
    run_dir = tmp_path / "run"
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        words = ["up", EXPLORE, f"--{view}", "--port", port, "--run-dir", str(run_dir)]
        code, _, problems = mrbt(*words)
    assert code == 2, problems
    assert port in problems or "needs the extra" in problems
    assert not run_dir.exists()


def test_a_view_of_a_robot_that_is_not_there_is_refused_before_robots_begin(tmp_path: Path) -> None:
    run_dir = tmp_path / "run"
    words = ["up", EXPLORE, "--web", "--port", "0", "--robot", "X9", "--run-dir", str(run_dir)]
    code, _, problems = mrbt(*words)
    assert (code, "--robot X9: mission explore has no robot 'X9'" in problems) == (2, True), (
        problems
    )
    assert not run_dir.exists()
