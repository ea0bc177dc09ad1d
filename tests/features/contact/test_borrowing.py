"""Robots that operators borrow from a team that works."""

from __future__ import annotations

import pytest

from mrbt_mesh.core.agent.operator_messages import RESTORE
from mrbt_mesh.features.contact.loans import Loans
from mrbt_mesh.sim import Command, Fault, Kill, Restart
from mrbt_mesh.sim.world.faults import Operate
from tests.sim.test_run_jobs import run, submit, works
from tests.support.effort import seeds

BORROWED = "borrowed by anna"


def borrow(robot: str, when: str = "at_once") -> Fault:
    return Operate(robot, f"borrowed/{robot}", when, "anna")


@pytest.mark.parametrize("seed", seeds(5))
def test_a_borrowed_robot_hands_its_task_over_and_gets_none_until_it_is_returned(seed: int) -> None:
    job = (3.0, submit("A1", "one", "deliver", "7", "dock_1"))
    result, _ = run(job, seconds=4.5, seed=seed)
    (worker,) = {e["robot"] for e in result.events if e["event"] == "start"}
    result, ends = run(job, (4.5, borrow(worker)), seconds=60, seed=seed)
    assert ends["one"][0] == "succeeded"
    assert worker not in {robot for _, robot, _, _ in works(result)}
    (cancel,) = (e for e in result.events if e["event"] == "cancel")
    assert (cancel["robot"], round(float(cancel["t"]), 1)) == (worker, 4.5)
    member = result.observer.facts.members[worker].member
    assert set(member.pending.values()) == {BORROWED}
    assert not member.lost, "it is not a fault"
    others = [(50.0, borrow(r)) for r in ("A1", "A2") if r != worker]
    again = (40.0, submit("A1", "two", "deliver", "8", "dock_1"))
    returned = (60.0, borrow(worker, "returned"))
    result, ends = run(
        job, (4.5, borrow(worker)), (30.0, others[0][1]), again, returned, seconds=90, seed=seed
    )
    assert ends["two"] == ("succeeded", ("B1", worker) if worker > "B1" else (worker, "B1"))


@pytest.mark.parametrize("seed", seeds(5))
def test_a_robot_may_be_borrowed_after_its_task(seed: int) -> None:
    job = (3.0, submit("A1", "one", "inspect", "dock_1"))
    later = (3.6, submit("A1", "two", "inspect", "dock_1"))
    result, ends = run(job, (3.5, borrow("B1", "after_task")), later, seconds=60, seed=seed)
    assert ends == {"one": ("succeeded", ("B1",))}
    plan = result.observer.plan
    assert plan is not None
    assert [waiting.activation.split("@")[1][:3] for waiting in plan.waiting] == ["two"]


@pytest.mark.parametrize("seed", seeds(5))
def test_it_stays_borrowed_when_it_starts_again_and_faults_end(seed: int) -> None:
    result, ends = run(
        (3.0, borrow("B1")),
        (5.0, Kill("B1")),
        (9.0, Restart("B1")),
        (12.0, Command("B1", RESTORE, "all")),
        (13.0, submit("A1", "one", "inspect", "dock_1")),
        seed=seed,
    )
    assert ends == {}
    facts = result.observer.facts
    assert facts.index(Loans).by_robot["B1"] == ("anna", "at_once")
    assert result.observer.plan is not None
    assert result.observer.idle["B1"] == BORROWED
    assert facts.members["B1"].member.pending == {"look": BORROWED}
