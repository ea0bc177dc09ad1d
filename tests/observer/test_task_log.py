"""States of global tasks in stories of two agents."""

from __future__ import annotations

import pytest

from mrbt_mesh.observer.task_log import TaskState
from tests.support.script import Script

IDLE, RUNNING, SUCCESS, FAILURE, CANCELLED = TaskState
THEN_LOOK = 'Sequence(Fallback("?clean", "weld"), "look")'
CLEAN = 'Fallback("?clean", "weld")'
CLEAN_AGAIN = "set B clean=true; pass 100; set B clean=false; pass 100"
LATE = "stop_slowly A; set B clean=true; pass 100"
BOTH_FAIL = "fail A; pass 100; fail B; pass 100"
TWO = "task weld weld 2..2"


@pytest.mark.parametrize(
    ("tree", "commands", "weld", "look"),
    [
        # The condition that comes with the outcome takes the task's node out of reach.
        (THEN_LOOK, "", RUNNING, IDLE),
        (THEN_LOOK, "succeed A clean=true", SUCCESS, RUNNING),
        (THEN_LOOK, "succeed A clean=true; pass 100; succeed A", SUCCESS, SUCCESS),
        # If the condition comes true by itself the task is cancelled, until it is needed again.
        (THEN_LOOK, "set B clean=true", CANCELLED, RUNNING),
        (THEN_LOOK, CLEAN_AGAIN, RUNNING, CANCELLED),
        (THEN_LOOK, f"{CLEAN_AGAIN}; succeed A clean=true", SUCCESS, RUNNING),
        # An outcome that comes too late still counts.
        (THEN_LOOK, LATE, CANCELLED, RUNNING),
        (THEN_LOOK, f"{LATE}; succeed A", SUCCESS, RUNNING),
        # The Parallel is over, and with it the mission.
        ('Parallel(1, "weld", "look")', "succeed A", SUCCESS, CANCELLED),
        ('Fallback(Timeout(1, "weld"), "look")', "pass 1500", CANCELLED, RUNNING),
        # A failure is known although the task is out of reach.
        ('Fallback("?clean", Sequence("weld", "look"))', BOTH_FAIL, FAILURE, IDLE),
        (
            'Fallback("?clean", Sequence("weld", "look"))',
            f"{BOTH_FAIL}; set A clean=true",
            FAILURE,
            IDLE,
        ),
        ('Sequence("weld", "look")', "operate A paused pause", RUNNING, IDLE),
        ('Sequence("weld", "look")', "operate A aborted true", CANCELLED, IDLE),
    ],
)
def test_states_of_tasks(tree: str, commands: str, weld: TaskState, look: TaskState) -> None:
    assert states(tree, commands) == {"weld": weld, "look": look}


@pytest.mark.parametrize(
    ("task", "commands", "weld"),
    [
        (TWO, "succeed A; pass 100", RUNNING),
        (TWO, "succeed A; pass 100; set A clean=true", CANCELLED),
        (TWO, "succeed A; pass 100; succeed B clean=true", SUCCESS),
        (f"{TWO} simultaneous", "succeed A; succeed B clean=true", SUCCESS),
    ],
)
def test_a_task_needs_enough_successes(task: str, commands: str, weld: TaskState) -> None:
    assert states(CLEAN, commands, task) == {"weld": weld}


def states(tree: str, commands: str, *tasks: str) -> dict[str, TaskState]:
    """The states at the end of a story of two robots, A and B."""
    script = Script()
    script.block(["robot A weld look", "robot B weld look", *tasks, f"tree {tree}", "observe"])
    steps = commands.split("; ") if commands else []
    script.block(["start A B", "pass 200", *steps, "pass 200"])
    observer = script.team.observer
    assert observer is not None
    return {name: record.state for name, record in observer.record.task_log.tasks.items()}
