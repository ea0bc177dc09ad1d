"""What is said of the future: by the schedule in force, and what robots do now."""

from __future__ import annotations

from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import Claim, Overtaken, Phase, Proposal, ProposedStep
from mrbt_mesh.observer.forecast import Forecast, RobotForecast, forecast
from tests.core.planning.test_schedules import FAR, ahead, line, propose, travelling
from tests.support.build import World, action, make_mission, parallel, task


def told(world: World, **elapsed_ms: int) -> Forecast:
    return forecast(world.facts, ahead(world), elapsed_ms)


def claim(world: World, robot: str, subject: str, phase: Phase) -> None:
    requests = world.plan().evaluation.requests
    name = next(each.activation for each in requests if each.subject == subject)
    value = Claim(name, subject, subject, phase, 1, place="a")
    world.write(robot, (records.CLAIM, value))


def test_where_robots_go_next_and_when_and_why() -> None:
    world = line()
    assert str(told(world)) == "schedule by rules for makespan, 4 tasks, ends in 22.0 s"
    propose(world, "R2", *FAR)
    found = told(world)
    assert str(found) == "schedule by R2 for makespan, 4 tasks, ends in 32.0 s"
    assert found.robots["R1"].where == "a"
    assert found.robots["R1"].next_text() == "c in 20.0 s, then d in 31.0 s"
    assert found.to_json()["robots"]["R2"]["next"] == "b in 20.0 s, then a in 31.0 s"


def test_what_robots_do_now_counts_as_far_as_it_is_known() -> None:
    world = line()
    propose(world, "R2", *FAR)
    claim(world, "R1", "c", Phase.TRAVELLING)

    def one(**elapsed_ms: int) -> RobotForecast:
        return told(world, **elapsed_ms).robots["R1"]

    assert one().where == "a -> c"
    assert one().next_text(1) == "c in 20.0 s, and 1 more", "it has said nothing"
    assert one(R1=15_000).next_text(1) == "c in 5.0 s, and 1 more"
    assert one(R1=95_000).next_text(1) == "c in 0.0 s, and 1 more", "it is late"
    way = world.facts.valid_claim("R1")
    assert way is not None
    world.write("R1", (records.OVERTAKEN, Overtaken(way.activation, False, 8_000, {})))
    assert one().next_text(1) == "c in 8.0 s, and 1 more"
    assert one(R1=5_000).next_text(1) == "c in 8.0 s, and 1 more", "not taken off twice"
    assert one(R1=15_000).next_text(1) == "c in 5.0 s, and 1 more"
    claim(world, "R1", "c", Phase.RUNNING)
    assert one(R1=200).next_text(1) == "c for 0.8 s more, and 1 more"


def test_partners_and_what_schedules_leave_out() -> None:
    pair = task("b", ("b", 2, 2), simultaneous=True)
    mission = make_mission(
        parallel(3, action("b"), action("c"), action("d")),
        {"R1": dict.fromkeys("bcd", 1.0), "R2": dict.fromkeys("bc", 1.0)},
        [pair, task("d", ("d", 1, 1), exclusive=True)],
    )
    world = World(travelling(mission, {each: each for each in "bcd"}, {"R1": "a", "R2": "d"}))
    names = [each.request.activation for each in ahead(world).opens]
    steps = ProposedStep(names[0], (("R1", "R2"),)), ProposedStep(names[1], (("R2",),))
    world.write("R1", (records.SCHEDULE, Proposal(steps)))
    found = told(world)
    assert found.robots["R2"].next_text() == "b with R1 in 20.0 s, then c in 31.0 s"
    assert found.to_json()["left_out"] == [{"global_task": "d", "reason": "it is exclusive"}]
