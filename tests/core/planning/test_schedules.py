"""Schedules in plans: which one is in force, who goes where by it, and that it stops nobody."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import Proposal, ProposedStep
from mrbt_mesh.core.facts.store import parse_entry
from mrbt_mesh.core.facts.values import MAX_TEXT
from mrbt_mesh.core.mission.mission import MICRO, GlobalTask, Mission
from mrbt_mesh.core.mission.travel import Travel
from mrbt_mesh.core.planning.plan import RobotAssignment
from mrbt_mesh.core.planning.schedules import Lookahead
from mrbt_mesh.core.scheduling.dispatch import Dispatcher
from mrbt_mesh.core.scheduling.problem import course_of
from mrbt_mesh.features.exclusive.coalitions import ready_members
from mrbt_mesh.features.exclusive.kinds import COALITION
from mrbt_mesh.features.exclusive.records import Coalition, CoalitionId
from tests.support.build import (
    World,
    action,
    jointly,
    make_mission,
    parallel,
    refusal,
    sequence,
    task,
)

X = {"a": 0, "b": 10, "c": 20, "d": 30}


def travelling(mission: Mission, at: dict[str, str], start: dict[str, str]) -> Mission:
    places = {name: (x * MICRO, 0) for name, x in X.items()}
    return replace(mission, travel=Travel(places, at, start, {"T": MICRO}))


def line(tasks: list[GlobalTask] | None = None) -> World:
    """One robot at each end of a line; a task at each place, in pairs: b before a, c before d."""
    tree = parallel(2, sequence(action("b"), action("a")), sequence(action("c"), action("d")))
    can = dict.fromkeys(X, 1.0)
    mission = make_mission(tree, {"R1": can, "R2": can}, tasks or ())
    return World(travelling(mission, {name: name for name in X}, {"R1": "a", "R2": "d"}))


def ahead(world: World) -> Lookahead:
    found = world.plan().ahead
    assert found is not None
    return found


def propose(world: World, author: str, *steps: tuple[str, str]) -> None:
    """A proposal of one robot for each task, by names."""
    names = {each.request.subject: each.request.activation for each in ahead(world).opens}
    rows = tuple(ProposedStep(names[subject], ((robot,),)) for subject, robot in steps)
    world.write(author, (records.SCHEDULE, Proposal(rows)))


def who(world: World) -> dict[str, str]:
    return {robot: each.global_task for robot, each in world.plan().assignments.items()}


def costs(world: World) -> int | None:
    course = ahead(world).course
    return None if course is None else course.cost


NEAR = (("b", "R1"), ("c", "R2"), ("a", "R1"), ("d", "R2"))
FAR = (("c", "R1"), ("b", "R2"), ("d", "R1"), ("a", "R2"))
BY_RULES, BETTER = 22_000, 21_000


def crossed() -> World:
    """The first task is nearer to R1 than to R2; R1 is at the place of the second."""
    can = {"a": 1.0, "b": 1.0}
    tree = parallel(2, action("b"), action("a"))
    mission = make_mission(tree, {"R1": can, "R2": can})
    return World(travelling(mission, {name: name for name in "ab"}, {"R1": "a", "R2": "d"}))


def test_each_robot_has_its_first_open_task_of_the_schedule_in_force() -> None:
    world = line()
    assert (who(world), costs(world), ahead(world).author) == ({"R1": "b", "R2": "c"}, 22_000, "")
    world = crossed()
    assert (who(world), costs(world)) == ({"R1": "b"}, BY_RULES)
    assert world.idle() == {"R2": "a, b: the schedule has other robots for it"}
    propose(world, "R2", ("b", "R2"), ("a", "R1"))
    assert (who(world), costs(world)) == ({"R1": "a", "R2": "b"}, BETTER)
    assert ahead(world).author == "R2"
    world.succeed("a", "R1")
    assert who(world) == {"R2": "b"}


def test_a_robot_waits_for_what_is_not_asked_for_yet() -> None:
    tree = sequence(action("b"), action("a"))
    can = dict.fromkeys(X, 1.0)
    mission = make_mission(tree, {"R1": can, "R2": can})
    world = World(travelling(mission, {name: name for name in X}, {"R1": "c", "R2": "a"}))
    propose(world, "R1", ("b", "R1"), ("a", "R2"))
    assert (who(world), costs(world)) == ({"R1": "b"}, 12_000)
    assert world.idle() == {"R2": "next in the schedule: a"}


def test_robots_set_out_for_a_task_before_the_others_that_it_needs() -> None:
    tree = parallel(2, action("both"), action("long"))
    can = {"look": 1.0, "lift": 1.0}
    tasks = [task("long", ("look", 1, 1)), task("both", ("look", 1, 1), ("lift", 1, 1))]
    tasks[1] = replace(tasks[1], joint=jointly(simultaneous=True))
    mission = make_mission(tree, {"R1": can, "R2": can}, tasks)
    world = World(travelling(mission, {"look": "b", "lift": "b"}, {"R1": "a", "R2": "b"}))
    names = {each.request.subject: each.request.activation for each in ahead(world).opens}
    steps = ProposedStep(names["long"], (("R2",),)), ProposedStep(names["both"], (("R2",), ("R1",)))
    world.write("R1", (records.SCHEDULE, Proposal(steps)))
    assert who(world) == {"R1": "both", "R2": "long"}
    world.claim("R2", names["long"], "look")
    assert who(world) == {"R1": "both", "R2": "long"}
    assert {each.leader for each in world.plan().assignments.values()} == {"", "R1"}


def test_what_has_begun_stays_whatever_is_proposed() -> None:
    world = line()
    propose(world, "R1", *NEAR)
    world.claim("R1", world.activation("c"))
    assert who(world) == {"R1": "c"}
    assert world.idle() == {"R2": "next in the schedule: d"}
    assert costs(world) == 500 + 10_000 + 1_000 + 10_000 + 1_000  # half of `c`, then `b` and `a`


@pytest.mark.parametrize(
    "steps",
    [
        [("b", "R2")],
        [("b", "R2"), ("b", "R1"), ("a", "R1")],
        [("b", "R2"), ("a", "R3")],
    ],
    ids=["a task is missing", "a task comes twice", "a robot that is not there"],
)
def test_a_proposal_that_does_not_fit_is_mended(steps: list[tuple[str, str]]) -> None:
    world = crossed()
    propose(world, "R1", *steps)
    assert (who(world), costs(world)) == ({"R1": "a", "R2": "b"}, BETTER)


def test_what_comes_before_another_task_stays_before_it() -> None:
    world = line()
    propose(world, "R1", NEAR[2], *NEAR[:2], NEAR[3])
    assert (who(world), costs(world)) == ({"R1": "b", "R2": "c"}, 22_000)


def test_the_tasks_of_a_robot_that_has_died_go_to_others_at_once() -> None:
    world = crossed()
    propose(world, "R1", ("b", "R2"), ("a", "R1"))
    world.die("R2")
    assert (who(world), costs(world)) == ({"R1": "b"}, 2 * (10_000 + 1_000))


def test_tasks_that_schedules_leave_out_go_to_robots_that_have_nothing_to_do_now() -> None:
    world = line([task("a", exclusive=True)])
    assert ahead(world).left_out == {f"r1:{3}:a::0": "it is exclusive"}
    propose(world, "R1", ("b", "R1"), ("c", "R2"), ("d", "R2"))
    assert who(world) == {"R1": "b", "R2": "c"}
    world.succeed("b", "R1")
    assert who(world) == {"R1": "a", "R2": "c"}


def test_a_preemptive_task_that_schedules_leave_out_takes_robots_before_and_after_they_begin() -> (
    None
):
    """Or they would begin what the schedule says, and be taken off it, for ever."""
    tasks = [task("a", exclusive=True, preemptive=True), task("b")]
    mission = make_mission(
        parallel(2, action("a"), action("b")), {"R1": {"a": 1.0, "b": 1.0}}, tasks
    )
    world = World(travelling(mission, {"a": "a", "b": "b"}, {"R1": "a"}))
    world.claim("R1", world.activation("b"))
    assert who(world) == {"R1": "a"}
    world = World(travelling(mission, {"a": "a", "b": "b"}, {"R1": "a"}))
    propose(world, "R1", ("b", "R1"))
    assert costs(world) is not None
    assert who(world) == {"R1": "a"}


def test_proposals_of_missions_without_places_and_of_other_trees_are_refused() -> None:
    world = line()
    for steps, reason in (([["r1:1:b::0", [["R1"]]]], "names no node"), ([], None)):
        entry = parse_entry("R1", records.SCHEDULE, world.entries[0].version, steps)
        found = refusal(world.facts, entry)
        assert (reason is None) if found is None else (reason or "-") in found
    entry = parse_entry("R1", records.SCHEDULE, world.entries[0].version, [])
    assert refusal(World(make_mission(action("a"))).facts, entry) == "this mission has no schedules"
    for value in (
        None,
        [[]],
        [["r1:2:b::0", "R1"]],
        [["r1:2:b::0", [["R1"]], 5]],
        [["r1:2:b::0", [["R" * (MAX_TEXT + 1)]]]],
    ):
        with pytest.raises(ValueError, match="expected"):
            parse_entry("R1", records.SCHEDULE, world.entries[0].version, value)


# -- whatever is proposed, the team gets on -------------------------------------------------------


def drawn(draw: random.Random) -> World:
    """Tasks for one to three robots, some of them together, in pairs or free."""
    kinds = ("lift", "look", "weld")
    tasks, nodes = [], []
    for number in range(draw.randrange(2, 7)):
        needs = [(kind, 1, draw.choice((1, 1, 2))) for kind in draw.sample(kinds, 2)]
        together = draw.random() < 0.4
        tasks.append(task(f"t{number}", *needs, simultaneous=together))
        nodes.append(action(f"t{number}"))
    half = len(nodes) // 2
    tree = parallel(2, sequence(*nodes[:half]), parallel(len(nodes) - half, *nodes[half:]))
    robots = {
        f"r{i}": dict.fromkeys(draw.sample(kinds, draw.randrange(1, 4)), 1.0)
        for i in range(draw.randrange(3, 6))
    }
    at = {kind: draw.choice(list(X)) for kind in kinds if draw.random() < 0.8}
    start = {robot: draw.choice(list(X)) for robot in robots}
    return World(travelling(make_mission(tree, robots, tasks), at, start))


class Team:
    """Robots that follow their plan one after the other, and propose what they like."""

    def __init__(self, draw: random.Random) -> None:
        self.draw, self.world = draw, drawn(draw)

    def step(self) -> bool:
        """One robot begins what it has, or ends it; whether any did."""
        world, plan = self.world, self.world.plan()
        for robot, each in self.draw.sample(
            sorted(plan.assignments.items()), len(plan.assignments)
        ):
            claim = world.facts.valid_claim(robot)
            if claim is not None and claim.activation != each.activation:
                world.write(robot, (records.CLAIM, None))
                return True
            task = world.mission.global_tasks[each.global_task]
            if claim is None:
                world.claim(robot, each.activation, each.local_task, not (task.joint is not None))
                return True
            if claim.party:
                token = CoalitionId.parse(claim.party)
                world.end(each.activation, token, robot, True, each.local_task)
                return True
            if not (task.joint is not None):
                world.outcome(each.activation, True, robot, each.local_task)
                world.write(robot, (records.CLAIM, None))
                return True
            members = [a for a in plan.assignments.values() if a.activation == each.activation]
            counts = {need.local_task: need.min_robots for need in task.needs}
            if all(
                sum(a.local_task == name for a in members) >= count
                for name, count in counts.items()
            ):
                self.form(each.activation, members)
                return True
        return False

    def form(self, activation: str, members: list[RobotAssignment]) -> None:
        world = self.world
        planned = {each.robot: each.local_task for each in members}
        for robot, local_task in planned.items():
            world.ready(robot, activation, local_task)
        found = Coalition(tuple(ready_members(world.facts, activation, planned)))
        leader = min(planned)
        token = CoalitionId(1, leader, *world.alive[leader])
        world.write(leader, (f"{COALITION}/{activation}/{token}", found))
        for robot, local_task in planned.items():
            world.go(robot, activation, token, local_task)

    def propose(self) -> None:
        """A schedule from a random order, now and then with robots exchanged or tasks left out."""
        draw, world = self.draw, self.world
        found = ahead(world)
        if not found.opens:
            return
        order = list(range(len(found.opens)))
        draw.shuffle(order)
        schedule = Dispatcher(found.problem).dispatch(order).schedule
        steps = list(found.proposal(schedule).steps)
        if draw.random() < 0.3:
            draw.shuffle(steps)
        if draw.random() < 0.2:
            steps.pop()
        world.write(draw.choice(sorted(world.alive)), (records.SCHEDULE, Proposal(tuple(steps))))


@given(st.integers(0, 100_000))
def test_whatever_is_proposed_the_team_does_all_that_it_would_do_without(seed: int) -> None:
    draw = random.Random(seed)
    team = Team(draw)
    for _ in range(200):
        if draw.random() < 0.4:
            team.propose()
        if draw.random() < 0.05 and len(team.world.alive) > 1:
            team.world.die(draw.choice(sorted(team.world.alive)))
        found = ahead(team.world)
        if found.schedule is not None:
            assert found.course == course_of(found.problem, found.schedule), seed
        if not team.step():
            break
    unproposed = team.world.replayed(
        [each for each in team.world.entries if each.parts[0] != records.SCHEDULE]
    )
    assert unproposed.plan().assignments.keys() == team.world.plan().assignments.keys(), seed
