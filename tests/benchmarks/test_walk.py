"""What `python -m benchmarks.walk` counts."""

from __future__ import annotations

from benchmarks.walk.team import Walk
from benchmarks.walk.trace import Landing, Trace, begin, end, package
from mrbt_mesh.core.mission.names import is_robot_id


def test_figures_of_a_trace() -> None:
    files = ["core/agent/agent.py", "core/agent/work.py", "core/agent/agent.py", "core/engine.py"]
    trace = Trace([Landing("A", 1, file) for file in files] + [Landing("B", 2, "cli/app.py")])
    assert trace.figures() == {
        "files": 4,
        "packages": 3,
        "edges": 4,
        "jumps": 4,
        "jumps_between_packages": 2,
    }
    assert trace.entries_from_elsewhere("agent.py") == 1
    core = trace.within("core/")
    assert core.files()["core/agent/agent.py"] == 2
    assert (core.figures()["jumps"], trace.of("B").figures()["jumps"]) == (3, 0)
    assert len(trace.first_step().landings) == 4


def test_packages_of_the_core_are_counted_one_level_down() -> None:
    files = ["core/planning/make_plan.py", "core/engine.py", "cli/app.py", "__main__.py"]
    assert [package(file) for file in files] == ["core/planning", "core", "cli", ""]


def test_only_calls_into_the_product_are_landings() -> None:
    trace = begin()
    is_robot_id("A1")
    sorted([1])
    end()
    assert {landing.file for landing in trace.landings} == {"core/mission/names.py"}


def test_another_robot_starts_the_repair_that_an_outcome_led_to() -> None:
    walk = Walk()
    trace = walk.outcome()
    assert walk.started == "C1"
    step = trace.of("B1").first_step().within("core/")
    assert next(iter(step.files())) == "core/agent/agent.py"
    assert 0 < step.figures()["jumps"] < trace.figures()["jumps"]
    assert step.figures()["files"] <= 39
    assert step.figures()["edges"] <= 158


def test_another_robot_takes_over_what_a_dead_one_did() -> None:
    walk = Walk()
    trace = walk.kill()
    assert walk.started in ("A1", "C1")
    assert not trace.of("B1").landings
    assert trace.within("core/").figures()["edges"] <= 190
