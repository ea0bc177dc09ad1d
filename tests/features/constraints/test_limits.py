"""Side constraints of missions: who is put to work beside whom, and why requests wait for it."""

from __future__ import annotations

import itertools
import random
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

from mrbt_mesh.core.assignment.canonical import solve
from mrbt_mesh.core.assignment.problem import AssignmentProblem
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.bt.tree import NodeSpec
from mrbt_mesh.core.mission.mission import FailurePolicy, Mission, Need, SameRobotAs
from mrbt_mesh.core.planning.make_plan import make_plan
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.features.constraints.kinds import (
    SECTION,
    AtMost,
    Constraint,
    NeverTogether,
    NotAtOnce,
    constraints_of,
)
from tests.support.build import (
    World,
    action,
    fallback,
    make_mission,
    parallel,
    retry,
    sequence,
    task,
)
from tests.support.effort import seeds
from tests.support.oracle import brute_force


def limited(mission: Mission, *constraints: Constraint) -> World:
    return World(replace(mission, sections={SECTION: constraints}))


def plan(world: World) -> Plan:
    world.tick()
    return make_plan(world.facts, world.alive, default_solver)


def served(found: Plan) -> dict[str, str]:
    return {robot: line.global_task for robot, line in found.assignments.items()}


def reasons(found: Plan) -> dict[str, str]:
    return {waiting.global_task: waiting.reason for waiting in found.waiting}


def team(*names: str, can: tuple[str, ...] = ("a", "b", "c")) -> dict[str, dict[str, float]]:
    return {name: dict.fromkeys(can, 1) for name in names}


BOTH = parallel(2, action("a"), action("b"))


# -- never on the same demand -----------------------------------------------------------------


def test_rivals_are_never_on_the_same_demand() -> None:
    tasks = [task("a", ("a", 2, 2)), task("b", ("b", 1, 1))]
    mission = make_mission(BOTH, team("R1", "R2", "R3"), tasks)
    assert served(plan(limited(mission))) == {"R1": "a", "R2": "a", "R3": "b"}
    found = plan(limited(mission, NeverTogether(("R1", "R2"))))
    assert served(found) == {"R1": "a", "R2": "b", "R3": "a"}


def test_only_for_the_local_tasks_that_are_named() -> None:
    mission = make_mission(action("a"), team("R1", "R2"), [task("a", ("a", 2, 2))])
    rivals = ("R1", "R2")
    assert not plan(limited(mission, NeverTogether(rivals, ("b",)))).waiting
    found = plan(limited(mission, NeverTogether(rivals, ("a",))))
    assert reasons(found) == {"a": "blocked: only one of R1, R2 on the same a"}


def test_a_running_robot_keeps_its_rival_from_joining() -> None:
    mission = make_mission(action("a"), team("R1", "R2", "R3"), [task("a", ("a", 1, 2))])
    world = limited(mission, NeverTogether(("R1", "R2")))
    world.claim("R2", world.activation("a"))
    assert served(plan(world)) == {"R2": "a", "R3": "a"}
    world.die("R3")
    assert served(plan(world)) == {"R2": "a"}


# -- at most so many at work ------------------------------------------------------------------


def test_at_most_so_many_of_them_are_at_work() -> None:
    mission = make_mission(BOTH, team("R1", "R2"))
    found = plan(limited(mission, AtMost(("R1", "R2"), 1)))
    assert served(found) == {"R1": "a"}
    assert reasons(found) == {"b": "waiting: at most 1 of R1, R2 at work"}


def test_a_running_robot_counts_and_is_not_stopped() -> None:
    mission = make_mission(BOTH, team("R1", "R2", "R3"))
    world = limited(mission, AtMost(("R1", "R2"), 1))
    world.claim("R2", world.activation("b"))
    assert served(plan(world)) == {"R2": "b", "R3": "a"}
    # Two that run already, after a partition, say: both go on, and nobody joins them.
    world.claim("R1", world.activation("a"))
    assert served(plan(world)) == {"R1": "a", "R2": "b"}


def test_the_wait_ends_with_the_work_of_the_rival() -> None:
    mission = make_mission(BOTH, team("R1", "R2"))
    world = limited(mission, AtMost(("R1", "R2"), 1))
    world.claim("R2", world.activation("b"))
    assert reasons(plan(world)) == {"a": "waiting: at most 1 of R1, R2 at work"}
    world.succeed("b", "R2")
    world.write("R2", ("claim", None))
    assert served(plan(world)) == {"R1": "a"}


def test_a_preemptive_request_takes_the_rivals_robot() -> None:
    tasks = [task("a", preemptive=True)]
    mission = make_mission(BOTH, team("R1", "R2"), tasks)
    world = limited(mission, AtMost(("R1", "R2"), 1))
    world.claim("R2", world.activation("b"))
    found = plan(world)
    assert served(found) == {"R1": "a"}
    assert reasons(found) == {"b": "waiting: at most 1 of R1, R2 at work"}


# -- not at once ------------------------------------------------------------------------------


def test_tasks_that_share_something_are_served_one_after_the_other() -> None:
    tree = parallel(3, action("a"), action("b"), action("c"))
    world = limited(make_mission(tree, team("R1", "R2", "R3")), NotAtOnce(("a", "b"), 1))
    found = plan(world)
    assert served(found) == {"R1": "a", "R2": "c"}
    assert reasons(found) == {"b": "waiting: at most 1 of a, b at once"}
    world.claim("R3", world.activation("b"))
    found = plan(world)
    assert served(found) == {"R1": "c", "R3": "b"}
    assert reasons(found) == {"a": "waiting: at most 1 of a, b at once"}


def test_all_needs_of_one_task_are_served_together() -> None:
    tasks = [task("both", ("a", 1, 2), ("b", 1, 2)), task("c")]
    tree = parallel(2, action("both"), action("c"))
    world = limited(make_mission(tree, team("R1", "R2", "R3"), tasks), NotAtOnce(("both", "c"), 1))
    assert served(plan(world)) == {"R1": "both", "R2": "both", "R3": "both"}


def test_a_type_stands_for_all_its_tasks() -> None:
    tasks = [task("weld(1)", ("a", 1, 1)), task("weld(2)", ("a", 1, 1)), task("weld(3)")]
    tree = parallel(3, *(action(each.id) for each in tasks))
    mission = make_mission(tree, team("R1", "R2", "R3", can=("a", "weld")), tasks)
    assert len(served(plan(limited(mission, NotAtOnce(("weld",), 2))))) == 2
    assert len(served(plan(limited(mission, NotAtOnce(("weld(1)", "weld(2)"), 1))))) == 2


def test_every_constraint_that_alone_would_do_is_named() -> None:
    mission = make_mission(BOTH, team("R1", "R2"))
    world = limited(
        mission, AtMost(("R1", "R2"), 1), NeverTogether(("R1", "R2")), NotAtOnce(("a", "b"), 1)
    )
    text = "waiting: at most 1 of R1, R2 at work; at most 1 of a, b at once"
    assert reasons(plan(world)) == {"b": text}


# -- the robot that did something before ------------------------------------------------------


def pick_and_place(tree: NodeSpec, least: int = 1, **policies: Any) -> Mission:
    before = SameRobotAs("fetch", "pick")
    tasks = [
        task("fetch", ("pick", least, least)),
        replace(task("bring", **policies), needs=(Need("place", 1, 2, before),)),
    ]
    return make_mission(tree, team("R1", "R2", "R3", can=("pick", "place")), tasks)


def test_who_picked_places() -> None:
    world = World(pick_and_place(sequence(action("fetch"), action("bring"))))
    world.outcome(world.activation("fetch"), True, "R2", "pick")
    found = plan(world)
    assert served(found) == {"R2": "bring"}
    assert world.idle()["R1"] == "nothing it can do is needed now"


def test_all_who_picked_may_place_and_nobody_else_stands_in() -> None:
    world = World(pick_and_place(sequence(action("fetch"), action("bring")), least=2))
    activation = world.activation("fetch")
    world.outcome(activation, True, "R2", "pick")
    world.outcome(activation, True, "R3", "pick")
    world.outcome(activation, False, "R1", "pick")
    assert served(plan(world)) == {"R2": "bring", "R3": "bring"}
    world.die("R2")
    assert served(plan(world)) == {"R3": "bring"}
    world.die("R3")
    assert reasons(plan(world)) == {
        "bring": "blocked: place needs 1 that did pick of fetch, 0 alive"
    }


def test_the_newest_attempt_counts() -> None:
    tree = retry(3, sequence(action("fetch"), action("bring")))
    world = World(pick_and_place(tree, failure=FailurePolicy.PAPER))
    world.outcome(world.activation("fetch"), True, "R2", "pick")
    assert served(plan(world)) == {"R2": "bring"}
    world.outcome(world.activation("bring"), False, "R2", "place")
    world.outcome(world.activation("fetch"), True, "R3", "pick")
    assert served(plan(world)) == {"R3": "bring"}


def test_the_nearest_action_before_that_was_done_counts() -> None:
    either = fallback(action("fetch"), action("fetch"))
    world = World(pick_and_place(sequence(either, action("bring"), action("fetch"))))
    first, *_ = [r.activation for r in world.tick().requests]
    world.outcome(first, True, "R3", "pick")
    assert served(plan(world)) == {"R3": "bring"}


def test_a_coalition_is_formed_of_them_too() -> None:
    world = World(pick_and_place(sequence(action("fetch"), action("bring")), simultaneous=True))
    world.outcome(world.activation("fetch"), True, "R2", "pick")
    assert served(plan(world)) == {"R2": "bring"}


# -- against trying out everything ------------------------------------------------------------


def random_world(draw: random.Random) -> World:
    names = [f"R{n}" for n in range(1, draw.randrange(3, 7))]
    robots = {
        name: {t: draw.choice((1, 1, 2)) for t in "ab" if draw.random() < 0.8} for name in names
    }
    tasks = []
    for number in range(draw.randrange(2, 5)):
        needs = [
            (local, least, least + draw.randrange(2))
            for local in draw.sample("ab", draw.randrange(1, 3))
            for least in (draw.choice((1, 1, 2)),)
        ]
        tasks.append(task(f"g{number}", *needs))
    constraints: list[Constraint] = []
    for _ in range(draw.randrange(1, 4)):
        who = tuple(sorted(draw.sample(names, draw.randrange(2, len(names) + 1))))
        what = tuple(sorted(draw.sample([t.id for t in tasks], 2)))
        of_robots = (NeverTogether(who), NeverTogether(who, ("a",)), AtMost(who, 1), AtMost(who, 2))
        constraints.append(draw.choice((*of_robots, NotAtOnce(what, 1))))
    tree = parallel(len(tasks), *(action(each.id) for each in tasks))
    world = limited(make_mission(tree, robots, tasks), *constraints)
    requests = {r.subject: r.activation for r in world.tick().requests}
    for name in draw.sample(names, draw.randrange(3)):
        options = [
            (t.id, n.local_task) for t in tasks for n in t.needs if n.local_task in robots[name]
        ]
        if options:
            subject, local = draw.choice(options)
            world.claim(name, requests[subject], local, since=draw.randrange(1, 5))
    return world


Place = tuple[str, str]


def keeps(
    constraints: tuple[Constraint, ...],
    on: Mapping[str, Place],
    running: Mapping[str, Place],
    new: str,
) -> bool:
    """Whether robot `new` may be where it is, by the words of the document. `on` maps robots to
    (task, local task), those that run included.
    """
    subject, local = on[new]
    for constraint in constraints:
        match constraint:
            case NeverTogether(robots, locals_):
                rivals = [r for r in on if r != new and r in robots and on[r] == (subject, local)]
                if new in robots and rivals and (not locals_ or local in locals_):
                    return False
            case AtMost(robots, count):
                if new in robots and sum(r in robots for r in on) > count:
                    return False
            case NotAtOnce(tasks, count):
                begun = any(place[0] == subject for place in running.values())
                others = {place[0] for place in on.values() if place[0] in tasks}
                if subject in tasks and not begun and len(others) > count:
                    return False
    return True


@pytest.mark.parametrize("seed", seeds(6))
def test_plans_keep_the_constraints_and_requests_as_trying_out_everything_does(seed: int) -> None:
    draw = random.Random(seed)
    limited_requests = 0
    for case in range(60):
        world = random_world(draw)
        problems: list[AssignmentProblem] = []

        def noting(problem: AssignmentProblem, problems: Any = problems) -> Any:
            problems.append(problem)
            return default_solver(problem)

        noting.supports_constraints = True  # type: ignore[attr-defined]
        found = make_plan(world.facts, world.alive, noting)
        where = f"seed {seed}, case {case}: {constraints_of(world.mission)}, {found.to_json()}"
        requests = found.evaluation.requests
        assert found.feasible is (len(found.waiting) < len(requests) or not requests), where
        on = {r: (line.global_task, line.local_task) for r, line in found.assignments.items()}
        running = {r: on[r] for r, line in found.assignments.items() if line.pinned}
        for robot in on.keys() - running.keys():
            assert keeps(constraints_of(world.mission), on, running, robot), where
        for problem in problems:
            assert solve(problem, default_solver) == brute_force(problem), where
        limited_requests += sum(bool(w.held_by or w.obstacle) for w in found.waiting)
        _check_kept(world, found, where)
    assert limited_requests > 10


def _check_kept(world: World, found: Plan, where: str) -> None:
    """Requests in tree order; each is kept if some robots serve it with all kept before it."""
    pinned = {r: line for r, line in found.assignments.items() if line.pinned}
    running = {r: (line.global_task, line.local_task) for r, line in pinned.items()}
    free = [r for r in world.mission.robots if r not in pinned]
    kept: list[str] = []
    for request in found.evaluation.requests:
        subjects = [*kept, request.subject]
        slots = [
            (subject, need.local_task)
            for subject in subjects
            for need in world.mission.global_tasks[subject].needs
            for _ in range(
                need.min_robots - list(running.values()).count((subject, need.local_task))
            )
        ]
        if _seats(world, slots, free, running):
            kept.append(request.subject)
    waiting = [w.global_task for w in found.waiting]
    assert [r.subject for r in found.evaluation.requests if r.subject not in waiting] == kept, where


def _seats(
    world: World,
    slots: list[tuple[str, str]],
    free: list[str],
    running: dict[str, tuple[str, str]],
) -> bool:
    for robots in itertools.permutations(free, len(slots)):
        pairs = list(zip(robots, slots, strict=True))
        if all(slot[1] in world.mission.robots[robot].capabilities for robot, slot in pairs):
            on = running | dict(pairs)
            if all(keeps(constraints_of(world.mission), on, running, robot) for robot in robots):
                return True
    return False
