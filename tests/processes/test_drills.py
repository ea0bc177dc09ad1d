"""The short set of drills on real processes, and what `mrbt drill` says and leaves behind."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from mrbt_mesh.drills.drill_file import drill_files, load_drills
from mrbt_mesh.drills.namespaces import available
from tests.support.paths import ROOT
from tests.support.team import REPAIR, Team

SHIPPED = ROOT / "drills"
# Holds the mission until it is ended from outside.
LATER = "[{when: {local_task: use_screwdriver}, after: 1000, kill: C1}]"
QUICK = [path for path in drill_files(SHIPPED) if load_drills(path)[0].model.quick]


def report(team: Team, path: Path, *options: str) -> tuple[int, dict[str, Any]]:
    """Run a drill file; the exit status and the JSON report."""
    done = team.command("drill", str(path), "--json", "--brief", *options)
    assert done.returncode in (0, 1), done.stderr
    assert "Traceback" not in done.stderr, done.stderr
    return done.returncode, json.loads(done.stdout)


@pytest.mark.parametrize("path", QUICK, ids=lambda path: path.stem)
def test_the_short_set_is_green(team: Team, path: Path) -> None:
    code, data = report(team, path)
    assert code == 0, json.dumps(data, indent=1)
    assert data["green"] == len(data["runs"]) > 0
    assert team.running() == []
    assert not any((team.folder / "drills").iterdir()), "green runs leave no directories behind"


def small(team: Team, **changes: str) -> Path:
    """A drill of the small example."""
    given = {
        "name": "small",
        "mission": str(ROOT / "examples" / "explore" / "mission.yaml"),
        "speed": "10",
        "steps": "[{when: {local_task: explore(A)}, kill: {performing: explore(A)}}]",
        "expect": "{dead: {killed}, done: [{local_task: explore, times: 1}]}",
    } | changes
    path = team.folder / "small.yaml"
    path.write_text("".join(f"{key}: {value}\n" for key, value in given.items()))
    return path


def test_what_did_not_hold_is_told_and_the_run_is_kept(team: Team) -> None:
    path = small(team, expect="{dead: R1, alive: R1}")
    junit = team.folder / "junit.xml"
    code, data = report(team, path, "--junit", str(junit))
    assert code == 1
    (run,) = data["runs"]
    assert run["color"] == "red"
    wrong = [e for e in run["expectations"] if not e["holds"]]
    assert len(wrong) == 1, "one of the two cannot hold"
    assert (Path(run["run_dir"]) / "events.jsonl").exists()
    (case,) = ElementTree.fromstring(junit.read_text())[0]
    assert case[0].get("message") == f"{wrong[0]['expected']}: {wrong[0]['found']}"
    assert team.running() == []


def test_work_that_the_program_does_not_write_down_is_seen(team: Team) -> None:
    """The program writes no events and does not give up: two robots work at once."""
    program = team.folder / "robot.py"
    program.write_text(
        "import anyio\nfrom mrbt_mesh import RobotProgram, TaskContext\n"
        "robot = RobotProgram()\n\n@robot.local_task('*')\n"
        "async def work(task: TaskContext, *arguments):\n"
        "    with anyio.CancelScope(shield=True):\n"
        "        for _ in range(30):\n            await anyio.sleep(0.1)\n"
    )
    mission = team.folder / "mission.yaml"
    mission.write_text(
        "mission: own\nprogram: robot.py\nlocal_tasks: {scan: {work: 1}}\n"
        "robot_types: {t: {capabilities: {scan: 1}}}\nrobots: {R1: t, R2: t, R3: t}\n"
        "global_tasks: {do_scan: {needs: {scan: {min: 1, max: 1}}}}\ntree: do_scan\n"
    )
    path = small(
        team,
        mission=str(mission),
        timeout_s="40",
        steps="[{when: {local_task: scan, phase: running}, after: 0.2, stop: {performing: scan}}, "
        "{when: {takeover: scan}, after: 0.5, continue: {stopped}}]",
        expect="{never: [{local_task: scan}], repeated: 0}",
    )
    code, data = report(team, path)
    assert code == 1
    wrong = [each for each in data["runs"][0]["expectations"] if not each["holds"]]
    assert [each["found"] for each in wrong] == ["at most 2"], data


def test_a_robot_that_ends_by_an_error_is_red_with_its_last_words(team: Team) -> None:
    program = team.folder / "robot.py"
    program.write_text(
        "import os, sys, anyio, pathlib\nfrom mrbt_mesh import RobotProgram, TaskContext\n"
        "robot, ended = RobotProgram(), pathlib.Path(__file__).with_name('ended')\n\n"
        "@robot.local_task('explore')\n"
        "async def explore(task: TaskContext, area):\n"
        "    if task.robot == 'R2':\n"
        "        sys.stderr.write('the battery is empty\\n')\n"
        "        sys.stderr.flush()\n"
        "        ended.touch()\n"
        "        os._exit(7)\n"
        "    while not ended.exists():\n"  # or the others may do all of it without R2
        "        await anyio.sleep(0.01)\n"
    )
    mission = (ROOT / "examples" / "explore" / "mission.yaml").read_text()
    (team.folder / "mission.yaml").write_text(
        mission.replace("../../agents/explore.py", str(program))
    )
    path = small(team, mission="mission.yaml", steps="[]", expect="{}")
    code, data = report(team, path)
    assert code == 1
    (wrong,) = [e for e in data["runs"][0]["expectations"] if not e["holds"]]
    assert wrong["found"] == "R2 ended with status 7: the battery is empty"


def test_steps_whose_moment_never_comes_are_red(team: Team) -> None:
    path = small(team, steps="[{at: 100, kill: R1}]", expect="{}")
    code, data = report(team, path)
    assert code == 1
    (wrong,) = [e for e in data["runs"][0]["expectations"] if not e["holds"]]
    assert wrong["found"] == "step 1 of 1: its moment never came"


def test_repeat_timeline_and_keep(team: Team) -> None:
    done = team.command("drill", str(small(team)), "--repeat", "2", "--keep")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "2/2 small  wired" in done.stdout
    assert done.stdout.count("killed (SIGKILL)") == 2
    assert done.stdout.count("↻ R") == 2
    assert "✔ explore(A) done 1×: 1 (R" in done.stdout
    assert "2 green, 0 red, 0 skipped" in done.stdout
    assert len(list((team.folder / "drills").iterdir())) == 2


def test_an_interrupt_ends_all_processes(team: Team) -> None:
    command = [sys.executable, "-m", "mrbt_mesh", "drill"]
    command += [str(small(team, mission=str(REPAIR), steps=LATER, expect="{}"))]
    drill = subprocess.Popen(
        command, env=team.environment, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    try:
        team.wait_until(lambda: len(team.running()) >= 6, "six robots run")
        drill.send_signal(signal.SIGINT)
        _, problems = drill.communicate()
    finally:
        drill.kill()
    assert drill.returncode == 1
    assert b"stopped by the operator" in problems
    assert b"Traceback" not in problems
    assert team.running() == []


def test_a_drill_with_a_bad_network(team: Team) -> None:
    reason = available()
    if reason is not None:
        pytest.skip(reason)
    held = "when: {local_task: explore}"
    steps = f"[{{{held}, partition: [[R1], [R2]]}}, {{{held}, after: 0.2, heal: true}}]"
    path = small(team, network="namespaces", steps=steps, expect="{alive: [R1, R2]}")
    code, data = report(team, path)
    assert code == 0, json.dumps(data, indent=1)
    assert team.running() == []


def test_what_cannot_be_run_here_is_skipped_with_the_reason(team: Team) -> None:
    """Without iproute2 on the path there are no namespaces, whoever runs this."""
    team.environment["PATH"] = str(team.folder)
    junit = team.folder / "junit.xml"
    path = small(team, network="namespaces")
    done = team.command("drill", str(path), "--junit", str(junit))
    assert done.returncode == 0, done.stdout + done.stderr
    (case,) = ElementTree.fromstring(junit.read_text())[0]
    reason = case[0].get("message") or ""
    assert case[0].tag == "skipped"
    assert re.search(r"need Linux|need root|\(package iproute2\)", reason)
    assert f"skipped: {reason}" in done.stdout
    assert "0 green, 0 red, 1 skipped" in done.stdout
