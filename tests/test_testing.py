"""The fixture for tests of missions with one's own programs; used for the examples as well."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import anyio
import pytest

from mrbt_mesh import InputError, RobotProgram, TaskContext, TaskFailedError, pytest_plugin
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.formats.shipped import template_files, write_files
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim import simulate
from mrbt_mesh.testing import (
    Freeze,
    Kill,
    Lose,
    NetworkQuality,
    Perform,
    Restore,
    RunMission,
    Thaw,
    run,
)
from tests.support.paths import ROOT, mission_file

EXPLORE = mission_file("explore")


def exploring(seconds: float = 1.0, reason: str = "") -> RobotProgram:
    """A program that says nothing of what it does."""
    program = RobotProgram()

    @program.local_task("*")
    async def anything(task: TaskContext, *arguments: str) -> None:
        await anyio.sleep(seconds)
        if reason and task.robot == "R1":
            raise TaskFailedError(reason)

    return program


def test_starts_and_ends_of_a_program_that_records_nothing_itself() -> None:
    found = run(EXPLORE, exploring())
    assert found.result == "success"
    assert set(found.started()) == set(found.succeeded("explore")) == {"R1", "R2"}
    assert len(found.succeeded("explore(A)")) == 1
    assert found.failed() == found.cancelled() == []
    assert [end.at_s - start.at_s for start, end in zip(found.starts, found.ends, strict=True)] == [
        pytest.approx(1)
    ] * 2
    assert found.summary["result"] == "success"
    assert found.duration_s < 2


def test_a_program_is_told_that_time_is_virtual() -> None:
    """So that it can have its robot's body in the same process."""
    told = []
    program = RobotProgram()

    @program.local_task("*")
    async def anything(task: TaskContext, *arguments: str) -> None:
        told.append(task.simulation.is_virtual)

    run(EXPLORE, program)
    assert told == [True, True]


def test_a_program_that_records_its_work_is_recorded_once() -> None:
    program = load_program(load_mission(EXPLORE).program or "")
    assert program.record_work
    found = run(EXPLORE, program)
    assert len(found.starts) == len(found.ends) == 2
    result = simulate(load_mission(EXPLORE), program, seed=0)
    assert [event["t"] for event in result.events if event["event"] == "start"] == [
        event.at_s for event in found.starts
    ]


def test_faults_come_when_they_are_to_come() -> None:
    found = run(
        EXPLORE, exploring(5), faults=[(3, Thaw("R2")), (2, Kill("R1")), (2.5, Freeze("R2"))]
    )
    assert found.result == "success"
    (died,) = (each for each in found.faults if each.kind == "major" and each.robot == "R1")
    assert (died.until_s, found.succeeded()) == (None, ["R2", "R2"])
    assert (len(found.starts), len(found.ends)) == (3, 2)
    lost = run(EXPLORE, exploring(), faults=[(0.5, Lose("R1", "explore"))])
    assert (lost.cancelled(), lost.succeeded()) == (["R1"], ["R2", "R2"])


def test_failures_have_their_reasons() -> None:
    found = run(EXPLORE, exploring(reason="no way"))
    assert found.failed() == ["R1"]
    assert [(each.robot, each.reason) for each in found.failures] == [("R1", "no way")]


def test_the_same_again_and_with_another_seed() -> None:
    once, again, other = (run(EXPLORE, exploring(), seed=seed) for seed in (1, 1, 2))
    assert once.starts == again.starts
    assert once.whole.effect_log_digest == again.whole.effect_log_digest
    assert once.whole.effect_log_digest != other.whole.effect_log_digest


def test_a_run_that_does_not_end_in_time() -> None:
    found = run(EXPLORE, exploring(100), timeout_s=10)
    assert (found.result, found.succeeded()) == ("timeout", [])
    # What still runs then is cancelled.
    assert sorted(found.cancelled("explore")) == ["R1", "R2"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"program": RobotProgram()},
            "no function for the local task explore; add @robot.local_task",
        ),
        ({"program": "none.py"}, "there is no such file"),
        ({"mission": "none.yaml"}, "none.yaml"),
        ({"robots": ["R9"]}, "has no robot 'R9'; known: R1, R2"),
        ({"robots": "R1"}, r"a list of names is expected, e.g. \['R1'\]"),
        ({"robots": ["R1", "R2", "R1"]}, "robots: R1 is named twice"),
        ({"speed": 0}, "a speed above 0"),
        ({"speed": "2"}, "speed: a number from 0 is expected, not '2'"),
        ({"timeout_s": float("nan")}, "timeout_s: a number from 0 is expected, not nan"),
        ({"parameters": {"spede": 2}}, "has no parameter 'spede'"),
        *[
            ({"faults": [fault]}, r"^faults\[0\]: " + message)
            for fault, message in [
                (
                    (1, Kill("R9")),
                    "Kill.robot='R9'. at 1 s: mission explore has no robot 'R9'; kno",
                ),
                ((-1, Kill("R1")), "seconds: a number from 0 is expected, not -1"),
                (("1", Kill("R1")), "seconds: a number from 0 is expected, not '1'"),
                ((Kill("R1"), 1), r"\(seconds, fault\) is expected, e.g. "),
                (Kill("R1"), r"\(seconds, fault\) is expected, e.g. "),
                ((1, Lose("R1", "explroe")), ".* no local task 'explroe'; did you mean 'explore'"),
                ((1, Lose("R1", "explore(Z)")), ".* no local task 'explore.Z.'; did you mean"),
                ((1, Restore("R1", "x")), ".* no local task 'x'; known: all, explore, explore"),
                ((1, Perform("R1", "all", 2)), ".* a performance is that of one local task"),
                ((1, Perform("R1", "explore", -2)), ".* a performance is a number from 0 to"),
                ((1, Thaw("R1")), ".* R1 is not frozen at that time"),
                ((900, Kill("R1")), ".* the run is given up at 600 s; give it a longer timeout"),
                ((90, Kill("R1")), ".* the run had ended before, at "),
            ]
        ],
    ],
)
def test_what_does_not_fit_is_told(changes: dict[str, object], message: str) -> None:
    given: dict[str, object] = {"mission": EXPLORE, "program": exploring(), **changes}
    with pytest.raises(InputError, match=message):
        run(**given)  # type: ignore[arg-type]


def test_names_that_the_mission_does_not_have() -> None:
    found = run(EXPLORE, exploring())
    with pytest.raises(InputError, match=r"no global task 'explore_aera.A.'; did you mean 'expl"):
        found.status("explore_aera(A)")
    for names in (found.started, found.succeeded, found.failed, found.cancelled):
        for wrong in ("explroe", "explore(AA)", ""):
            with pytest.raises(InputError, match=f"no local task '{re.escape(wrong)}'; "):
                names(wrong)
    assert found.succeeded("explore( A )") == found.succeeded("explore(A)")


def test_a_performance_is_in_the_units_of_the_mission_file() -> None:
    """1 is what the mission file says: half of it takes the robot twice as long."""
    found = run(mission_file("vehicle_repair"), faults=[(1.0, Perform("A1", "replace_hw", 0.5))])
    assert found.summary["robots"]["A1"]["performances"] == {"replace_hw": 0.5}
    gone = run(EXPLORE, exploring(5), faults=[(1, Perform("R1", "explore", 0))])
    assert [(each.kind, each.robot, each.local_tasks) for each in gone.faults] == [
        ("minor", "R1", ("explore",))
    ]


def test_the_network_loses_messages() -> None:
    lossy = run(EXPLORE, exploring(), network=NetworkQuality(loss=0.2, delay_s=0.01), seed=3)
    assert lossy.result == "success"
    assert (
        lossy.whole.effect_log_digest != run(EXPLORE, exploring(), seed=3).whole.effect_log_digest
    )
    for wrong in ({"loss": 2}, {"delay_s": -1.0}, {"jitter_s": float("inf")}):
        with pytest.raises(InputError, match=f"{next(iter(wrong))}: a number from 0"):
            NetworkQuality(**wrong)


def test_a_promise_that_is_broken_fails_the_test(monkeypatch: pytest.MonkeyPatch) -> None:
    from dataclasses import replace

    from mrbt_mesh import testing

    def broken(*arguments: object, **more: object) -> object:
        return replace(simulate(*arguments, **more), violations=["I4: two plans"])  # type: ignore[arg-type]

    monkeypatch.setattr(testing, "simulate", broken)
    with pytest.raises(AssertionError, match="I4: two plans"):
        run(EXPLORE, exploring())


def test_files_lie_beside_the_test(run_mission: RunMission) -> None:
    found = run_mission("../examples/explore/mission.yaml", "../agents/explore.py")
    assert found.result == "success"
    assert found.status("explore_area(A)") == "success"


def test_pytest_finds_the_fixture_where_the_package_is_installed_and_loads_little() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    ((name, module),) = project["entry-points"]["pytest11"].items()
    assert name == module == pytest_plugin.__name__
    text = f"import sys, {module}; print(*(n.partition('.')[0] for n in sys.modules))"
    command = [sys.executable, "-c", text]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    assert {"anyio", "msgpack", "pydantic", "zenoh"}.isdisjoint(done.stdout.split())


def test_what_mrbt_new_writes_passes_its_own_tests(tmp_path: Path) -> None:
    """As a user runs them: pytest alone, in the new folder."""
    write_files(tmp_path / "team", template_files("team"))
    command = [sys.executable, "-m", "pytest", "-q", "-p", "mrbt_mesh.pytest_plugin"]
    done = subprocess.run(
        [*command, "-p", "no:cacheprovider", "--rootdir", str(tmp_path), str(tmp_path / "team")],
        capture_output=True,
        text=True,
        check=False,
        env={"PYTHONPATH": str(ROOT), "PATH": ""},
        cwd=tmp_path,
        timeout=240,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "4 passed" in done.stdout
