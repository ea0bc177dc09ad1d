"""How far the summary says that global tasks are, told by teams of agents."""

from __future__ import annotations

import pytest

from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.core.observer.task_log import TaskState
from tests.support.script import Script


def states(tree: str, *commands: str, tasks: tuple[str, ...] = ()) -> dict[str, TaskState]:
    """What an observer says at the end of a story of two robots, A and B."""
    script = Script()
    script.block(["robot A weld look", "robot B weld look", *tasks, f"tree {tree}", "observe"])
    script.block(["start A B", "pass 200", *commands, "pass 200"])
    return {name: record.state for name, record in seen(script).record.task_log.tasks.items()}


def seen(script: Script) -> Observer:
    observer = script.team.observer
    assert observer is not None
    return observer


IDLE, RUNNING, SUCCESS, FAILURE, CANCELLED = TaskState


def test_a_task_that_makes_true_what_it_was_wanted_for_is_done() -> None:
    """Its node is out of reach as soon as the condition holds, which came with the outcome."""
    tree = 'Sequence(Fallback("?clean", "weld"), "look")'
    assert states(tree) == {"weld": RUNNING, "look": IDLE}
    assert states(tree, "succeed A clean=true") == {"weld": SUCCESS, "look": RUNNING}
    assert states(tree, "succeed A clean=true", "pass 100", "succeed A") == {
        "weld": SUCCESS,
        "look": SUCCESS,
    }


def test_a_task_whose_condition_comes_true_by_itself_is_cancelled() -> None:
    tree = 'Sequence(Fallback("?clean", "weld"), "look")'
    assert states(tree, "set B clean=true") == {"weld": CANCELLED, "look": RUNNING}
    # It is wanted again, and done.
    again = ("set B clean=true", "pass 100", "set B clean=false", "pass 100")
    assert states(tree, *again)["weld"] is RUNNING
    assert states(tree, *again, "succeed A clean=true")["weld"] is SUCCESS


def test_an_outcome_that_comes_too_late_still_counts() -> None:
    tree = 'Sequence(Fallback("?clean", "weld"), "look")'
    late = ("stop_slowly A", "set B clean=true", "pass 100")
    assert states(tree, *late)["weld"] is CANCELLED
    assert states(tree, *late, "succeed A")["weld"] is SUCCESS


def test_what_stands_beside_the_one_that_decides_is_cancelled() -> None:
    """The Parallel is over, and with it the mission."""
    assert states('Parallel(1, "weld", "look")', "succeed A") == {
        "weld": SUCCESS,
        "look": CANCELLED,
    }


def test_a_task_that_was_failing_when_its_time_was_up_is_cancelled() -> None:
    tree = 'Fallback(Timeout(1, "weld"), "look")'
    assert states(tree, "pass 1500") == {"weld": CANCELLED, "look": RUNNING}


def test_a_failure_is_told_when_the_task_is_out_of_reach() -> None:
    tree = 'Fallback("?clean", Sequence("weld", "look"))'
    failed = ("fail A", "pass 100", "fail B", "pass 100")
    assert states(tree, *failed) == {"weld": FAILURE, "look": IDLE}
    assert states(tree, *failed, "set A clean=true") == {"weld": FAILURE, "look": IDLE}


def test_a_task_of_too_few_successes_is_no_success() -> None:
    tree = 'Fallback("?clean", "weld")'
    tasks = ("task weld weld 2..2",)
    once = ("succeed A", "pass 100")
    assert states(tree, *once, tasks=tasks)["weld"] is RUNNING
    assert states(tree, *once, "set A clean=true", tasks=tasks)["weld"] is CANCELLED
    both = (*once, "succeed B clean=true")
    assert states(tree, *both, tasks=tasks)["weld"] is SUCCESS


def test_a_coalition_that_succeeded_is_known_by_its_outcomes() -> None:
    tree = 'Fallback("?clean", "weld")'
    tasks = ("task weld weld 2..2 simultaneous",)
    assert states(tree, "succeed A", "succeed B clean=true", tasks=tasks)["weld"] is SUCCESS


@pytest.mark.parametrize(("order", "state"), [("pause", RUNNING), ("abort", CANCELLED)])
def test_what_the_operator_ends_is_cancelled(order: str, state: TaskState) -> None:
    assert states('Sequence("weld", "look")', f"tell A order {order}")["weld"] is state
