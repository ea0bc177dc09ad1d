"""What one robot's key can do to a team: lies of a robot that otherwise works as it should.

Without keys, so that checkers can read all messages: the lies are facts under the liar's own name,
which keys do not prevent. What relays can do is tried with keys, and judged by what was done.
"""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import anyio
import pytest

from mrbt_mesh import TaskContext
from mrbt_mesh.core.bt.tree import Kind
from mrbt_mesh.core.facts.jobs import hash_of
from mrbt_mesh.core.facts.records import (
    LATCH,
    Attempt,
    ChildResult,
    Claim,
    ConditionValue,
    Job,
    JobArchive,
    JobEnd,
    JobState,
    MissionResult,
    Phase,
    Proposal,
)
from mrbt_mesh.core.facts.values import MAX_STAMP
from mrbt_mesh.features.bids.facts import Bid
from mrbt_mesh.features.exclusive.coalitions import Coalitions
from mrbt_mesh.features.exclusive.records import Coalition, CoalitionId, CoalitionMember
from mrbt_mesh.features.revisions.records import AdoptedMission, HeldMission
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.sim import SimulationResult, simulate
from mrbt_mesh.sim.world.faults import Kill, Operate
from mrbt_mesh.sim.world.setup import LAUNCH_UNIX_US
from tests.support.effort import seeds
from tests.support.liar import Liar, Lie, lying

S = 1_000_000
LIE_S, SECONDS = 6.0, 26
WARD = mission_from_yaml(
    """
mission: ward
ends: never
local_tasks:
  look: {parameters: [n], work: 2}
  dose: {parameters: [n], work: 4}
  lift: {parameters: [n], work: 3}
  find: {parameters: [n], work: 2}
robot_types:
  nurse: {capabilities: {look: 1, dose: 1, lift: 1, find: 1}}
  helper: {capabilities: {find: 1}}
robots: {A1: nurse, A2: nurse, A3: nurse, A4: nurse, A5: helper}
conditions: {open: {default: true}, calm: {default: true}}
global_tasks:
  look: {parameters: [n], needs: {look($n): {min: 1, max: 1}}}
  dose: {parameters: [n], exclusive: true, in_doubt: hold, needs: {dose($n): {min: 1, max: 1}}}
  lift: {parameters: [n], simultaneous: true, needs: {lift($n): {min: 2, max: 2}}}
  find: {parameters: [n], needs: {find($n): {min: 1, max: 1, performance: bid}}}
jobs:
  look: {parameters: {n: {min: 1, max: 99}}, tree: look($n)}
  dose: {parameters: {n: {min: 1, max: 99}}, tree: dose($n)}
  lift: {parameters: {n: {min: 1, max: 99}}, tree: lift($n)}
  gated:
    parameters: {n: {min: 1, max: 99}}
    tree: {Sequence: [{Condition: open}, {Condition: calm}, look($n)]}
  rounds: {parameters: {n: {min: 1, max: 99}}, tree: {Repeat: {cycles: 3, do: look($n)}}}
  tries:
    parameters: {n: {min: 1, max: 99}}
    tree: {RetryUntilSuccessful: {attempts: -1, do: look($n)}}
  timed: {parameters: {n: {min: 1, max: 99}}, tree: {Timeout: {seconds: 60, do: look($n)}}}
  steps:
    parameters: {n: {min: 1, max: 99}}
    tree: {Sequence: {memory: while_running, children: [look($n), find($n)]}}
tree: {Jobs: {types: all, at_most: 20}}
""",
    "ward.yaml",
    Path(),
)
PROGRAM = RobotProgram(record_work=True)


async def work(task: TaskContext, *_: str) -> None:
    await anyio.sleep(task.simulation.duration_s)


for name in WARD.local_tasks:
    PROGRAM.local_task(name)(work)


@PROGRAM.bid("find")
async def near(*_: object) -> float:
    return 1.0


def submit(robot: str, name: str, kind: str, n: int, not_before_us: int = 0) -> Operate:
    job = Job(kind, (str(n),), 0, not_before_us, 0)
    return Operate(robot, f"job/{name}", job.to_value(), "me")


LATER_US = LAUNCH_UNIX_US + 3_000 * S
SCHEDULE: tuple[tuple[float, Operate], ...] = (
    (3.0, submit("A2", "look", "look", 1)),
    (3.1, submit("A2", "dose", "dose", 2)),
    (3.2, submit("A3", "lift", "lift", 3)),
    (3.3, submit("A3", "later", "look", 4, not_before_us=LATER_US)),
    (3.4, submit("A3", "late_dose", "dose", 5, not_before_us=LATER_US)),
    (5.5, submit("A3", "dosing", "dose", 6)),
    (5.6, submit("A3", "lifting", "lift", 7)),
    (5.7, submit("A3", "rounds", "rounds", 12)),
    (5.7, submit("A3", "tries", "tries", 13)),
    (5.8, submit("A3", "timed", "timed", 14)),
    (5.9, submit("A2", "steps", "steps", 15)),
    (10.0, submit("A2", "after_look", "look", 8)),
    (10.1, submit("A2", "after_dose", "dose", 9)),
    (10.2, submit("A3", "after_lift", "lift", 10)),
    (10.3, submit("A3", "after_gated", "gated", 11)),
)
OPEN = {"later", "late_dose"}


def states(result: SimulationResult, robot: str) -> dict[str, str]:
    jobs = result.agents[robot].view.facts.jobs
    assert jobs is not None
    return {k.id: str(k.end.state) if k.end else "open" for k in jobs if k.job or k.end}


def starts(result: SimulationResult, liar: str) -> dict[tuple[str, ...], int]:
    """How often each local task was begun, exclusive ones by anybody, others by honest robots."""
    begun = [e for e in result.events if e["event"] == "start"]
    begun = [e for e in begun if e["robot"] != liar or e["local_task"] == "dose"]
    keys = [(e["local_task"], *e["args"]) for e in begun]
    return {key: keys.count(key) for key in keys}


def judged(result: SimulationResult, liar: str, harm: Mapping[str, str] | None = None) -> None:
    """The honest robots go on, hold the same for true, and have done what was asked, once.

    `harm`: the jobs that a lie may keep them from, and the state of these.
    """
    honest = set(WARD.robots) - {liar}
    assert result.violations == []
    assert not honest & result.stops.keys(), "no honest robot has stopped"
    for robot in sorted(honest):
        assert result.agents[robot].view.incarnation.counter == 1, "none began another life"
        wanted = {fault.name.partition("/")[2] for _, fault in SCHEDULE}
        expected = {n: "open" if n in OPEN else "succeeded" for n in wanted}
        assert states(result, robot) == expected | dict(harm or {}), robot
    begun = starts(result, liar)
    assert not {key for key in begun if key[1] in ("4", "5")}, "what is not due was not begun"
    assert {begun["dose", n] for n in ("2", "6", "9")} == {1}


def tell(
    lie: Lie, liar: str, seed: int, every_s: float = 0.0, is_checked: bool = False
) -> SimulationResult:
    steps = [(round(at_s * S), fault) for at_s, fault in SCHEDULE]
    with lying(liar, lie, round(LIE_S * S), round(every_s * S)):
        return simulate(
            WARD, PROGRAM, seed=seed, schedule=steps, timeout_us=SECONDS * S, inspect=is_checked
        )


# -- lies of facts ----------------------------------------------------------------------------


def end(state: JobState, name: str = "later", robots: tuple[str, ...] = ("A2",)) -> Lie:
    def lie(liar: Liar) -> None:
        assert liar.facts.jobs is not None
        job = liar.facts.jobs.known[name].job
        assert job is not None
        stamp = liar.facts.max_stamp + 1
        record = JobEnd(state, job.type, job.arguments, "me", "", robots, stamp, job.content)
        liar.write((f"job_end/{name}", record))

    return lie


def fact(name: str, record: Any) -> Lie:
    return lambda liar: liar.write((name, record))


def of_work(kind: str, subject: str, record: Any = LATCH) -> Lie:
    """A fact about each activation of a task that somebody works on, or is to."""

    def lie(liar: Liar) -> None:
        names = [c.claim.activation for c in liar.facts.claims.values()]
        names += [request.activation for request in liar.plan.evaluation.requests]
        found = sorted({n for n in names if f":{subject}" in n})
        assert found, "the liar was too late"
        liar.write(*((f"{kind}/{name}", record) for name in found))

    return lie


def of_nodes(fact_kind: str, node_kind: Kind, record: Any = LATCH, child: str = "") -> Lie:
    """A fact about each node of a kind in the trees of jobs."""

    def lie(liar: Liar) -> None:
        mission = liar.facts.mission
        found = [node.index for node in mission.tree.nodes if node.kind is node_kind]
        names = [str(mission.evaluator.current_activation(index, liar.facts)) for index in found]
        assert names, "the liar was too early"
        liar.write(*((f"{fact_kind}/{name}{child}", record) for name in names))

    return lie


def of_requests(kind: str, subject: str, record: Any = LATCH) -> Lie:
    """A fact about the local task of each running action of a global task."""

    def lie(liar: Liar) -> None:
        asked = liar.plan.evaluation.requests
        names = [r.activation for r in asked if r.activation.split(":")[2].startswith(subject)]
        assert names, "the liar was too early"
        liar.write(*((f"{kind}/{n}/{n.split(':')[2]}", record) for n in names))

    return lie


def claim_of_a_job_that_is_not_due(liar: Liar) -> None:
    """It says that it works on it."""
    assert liar.plan.evaluation.requests
    some = liar.plan.evaluation.requests[0].activation
    run, node, *_ = some.split(":")
    name = f"{run}:{node.partition('@')[0]}@later:look(4)::0"
    liar.write(("claim", Claim(name, "look(4)", "look(4)", Phase.RUNNING, 1)))


def of_coalitions(kind: str, subject: str) -> Lie:
    def lie(liar: Liar) -> None:
        facts = [
            (f"{kind}/{name}/{token}", LATCH)
            for name, said in sorted(liar.facts.activations.items())
            if isinstance(said.joint, Coalitions) and f":{subject}" in name
            for token in {*said.joint.members, *said.joint.grants}
        ]
        assert facts, "the liar was too late"
        liar.write(*facts)

    return lie


def false_coalition(liar: Liar) -> None:
    """It leads the others, at once, in what they are at."""
    me, life = liar.context.me, liar.context.replica.incarnation
    token = CoalitionId(1, me, *life)
    for claim in [each.claim for each in liar.facts.claims.values()]:
        task = liar.facts.task_of(claim.activation)
        if task is not None and task.joint is not None:
            members = tuple(
                CoalitionMember(robot, claim.local_task, 1, "n", 1, 1) for robot in ("A2", "A3")
            )
            name = f"coalition/{claim.activation}/{token}"
            liar.write((name, Coalition(members)))


def archive(number: int, *names: str) -> Lie:
    hashes = array("Q", sorted(map(hash_of, names)))
    return fact(f"job_archive/{number}", JobArchive(hashes, array("Q", [0] * len(hashes))))


def many(*lies: Lie) -> Lie:
    def lie(liar: Liar) -> None:
        for each in lies:
            each(liar)

    return lie


HUGE = MAX_STAMP
LIES: Mapping[str, Lie] = {
    "a job that nobody began has succeeded": end(JobState.SUCCEEDED),
    "a job that nobody began has succeeded by nobody": end(JobState.SUCCEEDED, robots=()),
    "a job that nobody began has succeeded by the liar": end(JobState.SUCCEEDED, robots=("A5",)),
    "a job that nobody began has failed": end(JobState.FAILED),
    "a job that nobody began has expired": end(JobState.EXPIRED, robots=()),
    "an exclusive job that nobody began has succeeded": end(JobState.SUCCEEDED, "late_dose"),
    "a job at work has succeeded": end(JobState.SUCCEEDED, "dosing"),
    "a job at work has failed": end(JobState.FAILED, "dosing"),
    "a job at work has expired": end(JobState.EXPIRED, "dosing", ()),
    "a job of several at work has succeeded": end(JobState.SUCCEEDED, "lifting", ("A1", "A2")),
    "a job that comes later has ended": fact(
        "job_end/after_look", JobEnd(JobState.SUCCEEDED, "look", ("8",), "me", "", ("A2",), 1)
    ),
    "a job that comes later has failed": fact(
        "job_end/after_dose", JobEnd(JobState.FAILED, "dose", ("9",), "me", "so", (), HUGE)
    ),
    "a job is due": fact("job_due/later", LATCH),
    "an exclusive job is due": fact("job_due/late_dose", LATCH),
    "jobs have ended long ago": archive(1, "later", "after_look", "after_dose"),
    "jobs have ended long ago, by the greatest number": archive(10**15 - 1, "look", "later"),
    "archives of no jobs push out others": many(*(archive(10**14 + n) for n in range(40))),
    "a revision is in force": fact("mission_adopted/1", AdoptedMission("0" * 64)),
    "revisions have the greatest number": fact("mission_held", HeldMission(HUGE, "", "", HUGE)),
    "a revision without a text was refused": fact("mission_held", HeldMission(1, "x", "no", 0)),
    "a condition with the greatest revision": fact(
        "condition/open", ConditionValue(False, HUGE, HUGE)
    ),
    "a condition with the greatest stamp": fact("condition/open", ConditionValue(True, 2, HUGE)),
    "a condition turns twice, far ahead": many(
        fact("condition/calm", ConditionValue(False, (1 << 32) - 1, 1)),
        fact("condition/calm", ConditionValue(True, 1 << 32, 1)),
    ),
    "a task at work has failed for good": of_work("latched_failure", "dose"),
    "a task for several has failed for good": of_work("latched_failure", "lift"),
    "a coalition at work is broken": of_coalitions("broken", "lift"),
    "an exclusive task is in doubt": of_coalitions("doubt", "dose"),
    "leases that were not asked for": of_coalitions("grant", "dose"),
    "a loop has used up the greatest number of attempts": of_nodes(
        "attempt", Kind.RETRY, Attempt(HUGE)
    ),
    "a loop has used up nearly the greatest number": of_nodes(
        "attempt", Kind.RETRY, Attempt(HUGE - 1)
    ),
    "a loop has used up more than anybody could have": of_nodes(
        "attempt", Kind.RETRY, Attempt((1 << 32) + 1)
    ),
    "a loop goes on far ahead": of_nodes("attempt", Kind.RETRY, Attempt(1 << 32)),
    "a loop has used up more cycles than it has": of_nodes("attempt", Kind.REPEAT, Attempt(3)),
    "a loop has used up the greatest number of cycles": of_nodes(
        "attempt", Kind.REPEAT, Attempt(HUGE)
    ),
    "the time of all loops is over": of_nodes("expired", Kind.REPEAT),
    "a step that a node with memory lacks has failed": of_nodes(
        "passed", Kind.SEQUENCE, ChildResult(False), "/9"
    ),
    "the steps of a loop have failed": of_nodes("passed", Kind.REPEAT, ChildResult(False), "/0"),
    "a task that is not exclusive has failed": of_work("latched_failure", "look"),
    "it works on a job that is not due": claim_of_a_job_that_is_not_due,
    "bids are over where nobody bids": of_requests("closed", "look"),
    "it bids for what nobody bids for": of_requests("bid", "look", Bid(HUGE)),
    "it schedules all work for itself": fact("schedule", Proposal(())),
    "the mission has succeeded": fact("result", MissionResult(True, 5)),
    "the mission has failed, as many agree": fact("result", MissionResult(False, HUGE)),
    "all of it": many(
        end(JobState.SUCCEEDED),
        end(JobState.FAILED, "dosing"),
        fact("job_due/late_dose", LATCH),
        of_work("latched_failure", "lift"),
        of_coalitions("grant", "dose"),
        fact("condition/open", ConditionValue(True, 2, HUGE - 10**9)),  # its own go on from there
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(1))
@pytest.mark.parametrize("lie", LIES.values(), ids=LIES)
def test_honest_robots_do_what_was_asked_in_spite_of_a_lie(lie: Lie, seed: int) -> None:
    judged(tell(lie, "A5", seed), "A5")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lie", "harm"),
    [
        (of_nodes("expired", Kind.TIMEOUT), {"timed": "failed"}),
        (of_coalitions("broken", "dose"), {"dose": "open", "dosing": "open"}),
    ],
    ids=["the time of a node is over", "exclusive coalitions are broken"],
)
def test_what_is_believed_as_written_harms_the_jobs_that_it_is_about_alone(
    lie: Lie, harm: Mapping[str, str]
) -> None:
    """An exclusive task is in doubt then, and an operator decides; it is not begun again."""
    judged(tell(lie, "A5", 1), "A5", harm)


def test_an_exclusive_task_that_a_liar_takes_is_not_done_twice() -> None:
    """It may hold the task, and never end it: nobody else begins."""
    result = tell(false_coalition, "A5", 1)
    assert not result.stops
    begun = starts(result, "A5")
    assert all(begun.get(("dose", n), 0) <= 1 for n in ("2", "6", "9"))
    assert states(result, "A1")["after_look"] == "succeeded"


@pytest.mark.parametrize("name", ["a job that nobody began has succeeded", "all of it"])
def test_the_invariants_hold_among_honest_robots(name: str) -> None:
    judged(tell(LIES[name], "A5", 1, is_checked=True), "A5")


# -- a liar that is gone ----------------------------------------------------------------------

TRIO = mission_from_yaml(
    """
mission: trio
ends: never
local_tasks:
  look: {parameters: [n], work: 2}
  dose: {parameters: [n], work: 4}
robot_types: {nurse: {capabilities: {look: 1, dose: 1}}}
robots: {A1: nurse, A2: nurse, A3: nurse}
global_tasks:
  look: {parameters: [n], needs: {look($n): {min: 1, max: 1}}}
  dose: {parameters: [n], exclusive: true, in_doubt: hold, needs: {dose($n): {min: 1, max: 1}}}
jobs:
  look: {parameters: {n: {min: 1, max: 99}}, tree: look($n)}
  dose: {parameters: {n: {min: 1, max: 99}}, tree: dose($n)}
tree: {Jobs: {types: all, at_most: 20}}
""",
    "trio.yaml",
    Path(),
)
LASTING_LIES = (
    "a job is due",
    "an exclusive job is due",
    "jobs have ended long ago",
    "a revision is in force",
    "the mission has succeeded",
)


@pytest.mark.parametrize("lie", [LIES[name] for name in LASTING_LIES], ids=LASTING_LIES)
def test_a_lie_says_no_more_once_the_liar_is_dead(lie: Lie) -> None:
    """Two robots that hear only one another do not take the word of a third that fell silent."""
    asked: list[tuple[float, Operate | Kill]] = [
        *SCHEDULE[3:5],
        (3.5, submit("A2", "look", "look", 1)),
        (8.0, Kill("A3")),
    ]
    asked += [(14.0, submit("A2", "after_look", "look", 8))]
    steps = [(round(at_s * S), fault) for at_s, fault in asked]
    with lying("A3", lie, round(LIE_S * S), 0):
        result = simulate(TRIO, PROGRAM, seed=1, schedule=steps, timeout_us=SECONDS * S)
    assert result.violations == []
    done = {"look": "succeeded", "after_look": "succeeded", "later": "open", "late_dose": "open"}
    for robot in ("A1", "A2"):
        assert states(result, robot) == done, robot
    assert not {key for key in starts(result, "A3") if key[1] in ("4", "5")}
