"""Small random missions, and their fault tolerance by counting everything."""

from __future__ import annotations

import itertools
import random
from collections.abc import Callable, Collection, Iterable
from dataclasses import replace
from functools import cache

from mrbt_mesh.core.bt.tree import Kind, Memory, Node, NodeSpec, build_tree
from mrbt_mesh.core.mission.conditions import ConditionType
from mrbt_mesh.core.mission.mission import (
    MICRO,
    GlobalTask,
    LocalTask,
    Mission,
    Need,
    Robot,
)
from tests.support.build import jointly

Fault = str | tuple[str, str]
MAX_CAPABILITIES = 9
_COMPOSITES = (
    *(Kind.SEQUENCE, Kind.SEQUENCE, Kind.SEQUENCE),
    *(Kind.FALLBACK, Kind.FALLBACK, Kind.PARALLEL, Kind.PARALLEL, Kind.IF_THEN_ELSE),
)
_DECORATORS = (
    Kind.INVERTER,
    Kind.FORCE_SUCCESS,
    Kind.FORCE_FAILURE,
    Kind.RETRY,
    Kind.REPEAT,
    Kind.TIMEOUT,
    Kind.KEEP_RUNNING_UNTIL_FAILURE,
)


def random_mission(seed: int) -> Mission:
    """At most 4 robots, 9 capabilities and 5 leaves; tasks that wait, fail, are exclusive."""
    pick, optional = random.Random(seed), random.Random(f"{seed}/optional")
    names = [f"l{i}" for i in range(pick.randint(1, 3))]
    robots: dict[str, Robot] = {}
    left = MAX_CAPABILITIES
    for number in range(pick.randint(1, 4)):
        able = [name for name in names if pick.random() < 0.75][:left]
        left -= len(able)
        robots[f"R{number}"] = Robot(f"R{number}", "T", dict.fromkeys(able, MICRO))
    if pick.random() < 0.15 and left > 1:  # one capability for a ground task beside its type
        robots["R0"] = Robot("R0", "T", {"l0": MICRO, "l0(1)": MICRO})
    tasks: dict[str, GlobalTask] = {}
    leaves = pick.randint(1, 5)

    def leaf() -> NodeSpec:
        if pick.random() < 0.25:
            return NodeSpec(Kind.CONDITION, subject=f"c{pick.randint(0, 1)}")
        name = f"g{pick.randint(0, 4)}"
        if name not in tasks:
            tasks[name] = _task(name, names, pick, optional)
        return NodeSpec(Kind.ACTION, subject=name)

    def node(budget: int, depth: int) -> NodeSpec:
        if depth < 4 and pick.random() < 0.15:
            kind = pick.choice(_DECORATORS)
            limit = pick.choice([-1, 2]) if kind in (Kind.RETRY, Kind.REPEAT) else 0
            timeout_us = 1 if kind is Kind.TIMEOUT else 0
            return NodeSpec(kind, (node(budget, depth + 1),), limit=limit, timeout_us=timeout_us)
        if budget == 1:
            return leaf()
        parts = pick.randint(2, min(3, budget))
        sizes = [budget // parts + (i < budget % parts) for i in range(parts)]
        children = tuple(node(size, depth + 1) for size in sizes)
        kind = pick.choice(_COMPOSITES)
        limit = pick.randint(1, parts) if kind is Kind.PARALLEL else 0
        memory = pick.choice((Memory.NONE, Memory.WHILE_RUNNING))
        return NodeSpec(kind, children, limit=limit, memory=memory)

    tree = build_tree(node(leaves, 1))
    return Mission(
        name=f"random_{seed}",
        robots=robots,
        robot_types={"T": dict.fromkeys(names, MICRO), "S": {names[0]: MICRO}},
        local_tasks={name: LocalTask(name) for name in names},
        conditions={name: ConditionType(name) for name in ("c0", "c1")},
        global_tasks={name: tasks[name] for name in sorted(tasks)},
        tree=tree,
    )


def _task(name: str, names: list[str], pick: random.Random, optional: random.Random) -> GlobalTask:
    chosen = pick.sample(names, pick.randint(1, min(2, len(names))))
    ground = [f"{each}(1)" if pick.random() < 0.15 else each for each in chosen]
    needs = tuple(
        Need(each, least := pick.choice([1, 1, 1, 2]), least + 1) for each in sorted(set(ground))
    )
    if len(needs) > 1 and optional.random() < 0.3:  # robots may help with it, and none has to
        needs = (needs[0], replace(needs[1], min_robots=0))
    waits = None if pick.random() < 0.5 else 1_000_000
    return GlobalTask(
        name,
        needs,
        blocked_fail_after_us=waits,
        joint=jointly(exclusive=pick.random() < 0.1, simultaneous=True),
    )


def is_able(mission: Mission, robot: str, local_task: str, faults: Collection[Fault]) -> bool:
    """As the runtime has it: losing the ground capability or its type is enough."""
    if robot in faults:
        return False
    kind = local_task.partition("(")[0]
    able = mission.robots[robot].capabilities
    if any(name in able and (robot, name) in faults for name in (local_task, kind)):
        return False
    return local_task in able or kind in able


def can_serve(mission: Mission, tasks: Iterable[str], faults: Collection[Fault]) -> bool:
    """By trying every way to put different robots on all that the tasks need."""
    chosen = [mission.global_tasks[task] for task in tasks]
    alive = [robot for robot in mission.robots if robot not in faults]
    if not all(can_decide(mission, task.id, faults) for task in chosen):
        return False
    seats = [n.local_task for task in chosen for n in task.needs for _ in range(n.min_robots)]
    return any(
        all(is_able(mission, robot, seat, faults) for robot, seat in zip(order, seats, strict=True))
        for order in itertools.permutations(alive, len(seats))
    )


def can_decide(mission: Mission, task: str, faults: Collection[Fault]) -> bool:
    """What is exclusive is decided by a majority only."""
    alive = sum(robot not in faults for robot in mission.robots)
    return not mission.global_tasks[task].at_most_once or alive > len(mission.robots) // 2


def outcomes(
    mission: Mission,
    node: Node,
    values: dict[int, bool],
    is_served: Callable[[str], bool],
    is_decided: Callable[[str], bool] = lambda _: True,
) -> set[bool]:
    """Which of success and failure a node can end with; neither: it waits for ever."""
    tree = mission.tree
    if node.kind is Kind.CONDITION:
        return {values[node.index]}
    if node.kind is Kind.ACTION:
        if is_served(node.subject):
            return {True, False}
        waits = mission.global_tasks[node.subject].blocked_fail_after_us is None
        return {False} if not waits and is_decided(node.subject) else set()
    children = [
        outcomes(mission, tree.nodes[c], values, is_served, is_decided) for c in node.children
    ]
    match node.kind:
        case Kind.SEQUENCE | Kind.FALLBACK:
            passing = node.kind is Kind.SEQUENCE
            found = set()
            for child in children:
                if passing not in child:
                    return found | child
                found |= child - {passing}
            return found | {passing}
        case Kind.PARALLEL:
            successes = sum(True in child for child in children)
            failures = sum(False in child for child in children)
            found = {True} if successes >= node.limit else set()
            return found | ({False} if failures > len(children) - node.limit else set())
        case Kind.IF_THEN_ELSE:
            condition, *branches = children
            branches += [{False}] * (2 - len(branches))
            chosen = zip((True, False), branches, strict=True)
            return set().union(*(branch for value, branch in chosen if value in condition))
    return _decorated(mission, node, children[0])


def _decorated(mission: Mission, node: Node, child: set[bool]) -> set[bool]:
    match node.kind:
        case Kind.INVERTER:
            return {not each for each in child}
        case Kind.FORCE_SUCCESS:
            return {True} if child else set()
        case Kind.FORCE_FAILURE:
            return {False} if child else set()
        case Kind.RETRY:
            return child - {False} if node.limit < 0 else child
        case Kind.REPEAT:
            return child - {True} if node.limit < 0 else child
        case Kind.KEEP_RUNNING_UNTIL_FAILURE:
            return child - {True}
        case Kind.TIMEOUT:
            return child | {False} if _acts(mission, node) else child
    return child


def _acts(mission: Mission, node: Node) -> bool:
    if node.kind is Kind.ACTION:
        return True
    return any(_acts(mission, mission.tree.nodes[child]) for child in node.children)


def survivor(mission: Mission) -> Callable[[frozenset[Fault]], bool]:
    """Whether a set of faults is survived, for all values of all conditions."""
    places = [node.index for node in mission.tree.nodes if node.kind is Kind.CONDITION]
    root = mission.tree.nodes[0]
    cases = [
        dict(zip(places, values, strict=True))
        for values in itertools.product([False, True], repeat=len(places))
    ]
    hopeful = [case for case in cases if True in outcomes(mission, root, case, lambda _: True)]

    @cache
    def survives(faults: frozenset[Fault]) -> bool:
        if not hopeful or faults.issuperset(mission.robots):
            return False
        served = {task: can_serve(mission, [task], faults) for task in mission.global_tasks}
        decided = {task: can_decide(mission, task, faults) for task in mission.global_tasks}
        asked = served.__getitem__, decided.__getitem__
        return all(True in outcomes(mission, root, case, *asked) for case in hopeful)

    return survives


def count_everything(
    faults: list[Fault], survives: Callable[[frozenset[Fault]], bool]
) -> tuple[int | None, int | None, list[Fault]]:
    """(max_tolerated, min_fatal, critical) by looking at every set of faults."""
    verdicts = {
        size: [survives(frozenset(each)) for each in itertools.combinations(faults, size)]
        for size in range(len(faults) + 1)
    }
    most = max((size for size, found in verdicts.items() if any(found)), default=None)
    fewest = min((size for size, found in verdicts.items() if not all(found)), default=None)
    is_feasible = survives(frozenset())
    critical = [f for f in faults if is_feasible and not survives(frozenset({f}))]
    return most, fewest, critical


def literal_minor(mission: Mission, fault: tuple[str, str]) -> bool:
    """The paper's lemma for one capability, by trying every assignment."""
    robot, name = fault
    return any(
        _holds_apart(mission, robot, {name}, {other})
        for other in mission.robots
        if other != robot and name in mission.robots[other].capabilities
    )


def literal_major(mission: Mission, robot: str) -> bool:
    """The paper's lemma for one robot, by trying every set of stand-ins and every assignment."""
    names = set(mission.robots[robot].capabilities)
    others = [each for each in mission.robots if each != robot]
    for size in range(len(others) + 1):
        for chosen in itertools.combinations(others, size):
            covered = {name for other in chosen for name in mission.robots[other].capabilities}
            if names <= covered and _holds_apart(mission, robot, names, set(chosen)):
                return True
    return False


def _holds_apart(mission: Mission, robot: str, names: set[str], others: set[str]) -> bool:
    """Problem (2) is consistent, the robot and the others never on one local task of `names`."""
    able = mission.robots[robot].capabilities

    def is_served(task: str) -> bool:
        seats = [
            need.local_task
            for need in mission.global_tasks[task].needs
            for _ in range(need.min_robots)
        ]
        for order in itertools.permutations(mission.robots, len(seats)):
            pairs = list(zip(order, seats, strict=True))
            if not all(is_able(mission, r, seat, ()) for r, seat in pairs):
                continue
            own = next((seat for r, seat in pairs if r == robot), None)
            kind = own.partition("(")[0] if own else None
            concerned = own is not None and any(
                name in names and name in able for name in (own, kind)
            )
            if not concerned or not any(r in others and seat == own for r, seat in pairs):
                return True
        return False

    places = [node.index for node in mission.tree.nodes if node.kind is Kind.CONDITION]
    root = mission.tree.nodes[0]
    hopeful = False
    for values in itertools.product([False, True], repeat=len(places)):
        case = dict(zip(places, values, strict=True))
        if True in outcomes(mission, root, case, lambda _: True):
            hopeful = True
            if True not in outcomes(mission, root, case, is_served):
                return False
    return hopeful
