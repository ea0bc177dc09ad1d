"""Facts of the workshop's world: what bodies and tools do, and what they cannot."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.support.workshop import needs_world

needs_world()

from bodies.messages import Command, Senses  # noqa: E402
from bodies.physics import KINDS, World  # noqa: E402

from mrbt_mesh.errors import InputError  # noqa: E402
from mrbt_mesh.formats.mission_file import load_mission  # noqa: E402
from tests.support.paths import mission_file  # noqa: E402

GRIP_X, HIGH = 2.66, 0.32
TIP_M = 0.45


def put(world: World, robot: str, x: float, y: float, heading: float, **joints: float) -> None:
    """Let a robot stand somewhere, its arm or fork where the joints say."""
    body = world.robots[robot]
    station = world.model.body(f"{robot}/base").pos
    values = {"x": x - station[0], "y": y - station[1], "turn": heading, **joints}
    for joint, value in values.items():
        drives = joint in ("x", "y", "turn")
        world.data.qpos[body.angles[joint]] = value
        world.data.qvel[body.speeds[joint]] = 0
        world.data.ctrl[body.motors[joint]] = body.given[joint] = 0.0 if drives else value
    world.settle()


def go_on(world: World, seconds: float, **commands: Command) -> None:
    """Let time pass while robots renew their commands ten times a second."""
    begin_s = world.time_s
    for count in range(1, round(seconds * 10) + 1):
        for robot, command in commands.items():
            world.exchange(robot, command)
        world.advance_to(begin_s + count / 10)


def without_screws(world: World) -> None:
    for name in world.screws:
        world.screws[name] = 1.0
        world.data.eq_active[world.model.equality(f"screw_{name}").id] = 0


def shift_cover(world: World, x: float, y: float = 0.0) -> None:
    frame = int(world.model.joint(world.model.body("frame").jntadr[0]).qposadr[0])
    world.data.qpos[frame : frame + 2] += (x, y)
    world.settle()


def ends(world: World) -> tuple[float, float]:
    """How far the cover's west and east end are up."""
    frame = world.model.body("frame").id
    middle, along = world.data.xpos[frame], world.data.xmat[frame].reshape(3, 3)[:, 0]
    west, east = (middle[2] - 0.38 + side * 1.8 * along[2] for side in (-1, 1))
    return west, east


def at_grips(world: World) -> None:
    put(world, "C1", -GRIP_X, 0, 0, reach=0.4)
    put(world, "C2", GRIP_X, 0, math.pi, reach=0.4)


def lift(up_m: float = HIGH) -> Command:
    return Command(reach_m=0.4, fork_m=up_m)


def above(world: World, site: str, robot: str, away: float = 0.9, south: bool = True) -> Command:
    """Put a robot's tip above a site; the command that keeps it there."""
    x, y, _ = world.data.site(site).xpos
    heading = math.pi / 2 if south else -math.pi / 2
    put(world, robot, x, y - away if south else y + away, heading, arm=away - TIP_M)
    return Command(arm_m=away - TIP_M)


def using(command: Command, tool: str) -> Command:
    return Command(arm_m=command.arm_m, tool=tool)


@pytest.fixture
def world() -> World:
    return World()


# -- the cover ---------------------------------------------------------------------------------


def test_one_robot_alone_only_tilts_the_cover(world: World) -> None:
    without_screws(world)
    at_grips(world)
    go_on(world, 5, C1=lift(), C2=lift(0.0))
    west, east = ends(world)
    assert west > 0.1
    assert east < 0.02
    assert not world.judged()["cover"]["is_off"]
    assert world.senses("C1").fork.tilt_rad < -0.03  # type: ignore[union-attr]


def test_two_robots_lift_it_and_carry_it_off_and_it_stays_level(world: World) -> None:
    without_screws(world)
    at_grips(world)
    go_on(world, 5, C1=lift(), C2=lift())
    assert min(ends(world)) > 0.2
    for robot in ("C1", "C2"):
        fork = world.senses(robot).fork
        assert fork is not None
        # Each holds half of 40 kg.
        assert fork.load_n == pytest.approx(20 * 9.81, rel=0.05)
        assert abs(fork.tilt_rad) < 0.005
    west = Command(left=0.5, reach_m=0.4, fork_m=HIGH)
    east = Command(left=-0.5, reach_m=0.4, fork_m=HIGH)
    go_on(world, 4, C1=west, C2=east)
    assert world.judged()["cover"]["is_off"]
    assert {"at_s": pytest.approx(8, abs=2), "what": "the cover is off"} in world.events


def test_screws_hold_the_cover_against_both(world: World) -> None:
    at_grips(world)
    go_on(world, 5, C1=lift(), C2=lift())
    assert max(ends(world)) < 0.02


def test_one_screw_is_enough_to_hold_it(world: World) -> None:
    without_screws(world)
    world.data.eq_active[world.model.equality("screw_2").id] = 1
    at_grips(world)
    go_on(world, 5, C1=lift(), C2=lift())
    assert ends(world)[1] < 0.1
    assert not world.judged()["cover"]["is_off"]


# -- screws ------------------------------------------------------------------------------------


def test_a_screw_comes_out_only_where_the_screwdriver_is(world: World) -> None:
    command = using(above(world, "screw_1", "C1", 1.0), "unscrew")
    go_on(world, 1.0, C1=command)
    assert 0 < world.screws["1"] < 1
    assert world.senses("C1").at_tip.name == "screw 1"  # type: ignore[union-attr]
    go_on(world, 1.0, C1=command)
    assert world.judged()["screws_out"] == ["1"]
    assert world.events[-1]["what"] == "screw 1 is out"
    # Ten centimetres beside the next one nothing happens.
    put(world, "C1", -1.35, 1.6, -math.pi / 2, arm=1.0 - TIP_M - 0.1)
    go_on(world, 3, C1=using(Command(arm_m=1.0 - TIP_M - 0.1), "unscrew"))
    assert world.senses("C1").at_tip is None
    assert world.judged()["screws_out"] == ["1"]


def test_a_screw_goes_in_only_where_its_hole_is(world: World) -> None:
    without_screws(world)
    shift_cover(world, 0.05)
    command = using(above(world, "screw_1", "C1", 1.0), "screw")
    go_on(world, 3, C1=command)
    assert world.screws["1"] == 1.0
    shift_cover(world, -0.05)
    command = using(above(world, "screw_1", "C1", 1.0), "screw")
    go_on(world, 3, C1=command)
    assert world.screws["1"] == 0.0


@pytest.mark.parametrize("robot", ["A1", "B1"])
def test_who_has_no_screwdriver_turns_no_screw(world: World, robot: str) -> None:
    go_on(world, 3, **{robot: using(above(world, "screw_1", robot, 1.0), "unscrew")})
    assert set(world.screws.values()) == {0.0}


# -- parts -------------------------------------------------------------------------------------


def uncovered(broken: tuple[str, ...] = ("2", "4")) -> World:
    world = World(broken)
    without_screws(world)
    shift_cover(world, 0.0, 3.2)
    world.advance_to(0.2)
    return world


@pytest.mark.parametrize(("part", "reading"), [("1", "good"), ("2", "broken")])
def test_a_probe_that_stays_long_enough_tells(part: str, reading: str) -> None:
    world = uncovered()
    command = using(above(world, f"part_{part}", "A1"), "probe")
    go_on(world, 0.5, A1=command)
    assert world.senses("A1").at_tip.reading == ""  # type: ignore[union-attr]
    go_on(world, 0.7, A1=command)
    assert world.senses("A1").at_tip.reading == reading  # type: ignore[union-attr]
    # Another robot's probe has measured nothing yet.
    above(world, f"part_{part}", "A2", 1.2)
    assert world.senses("A2").at_tip.reading == ""  # type: ignore[union-attr]


def test_below_the_cover_nothing_can_be_worked_on(world: World) -> None:
    go_on(world, 4, A1=using(above(world, "part_2", "A1"), "hardware"))
    tip = world.senses("A1").at_tip
    assert tip is not None
    assert tip.covered
    assert world.parts["2"].is_broken


def test_a_part_is_mended_step_by_step_and_by_whoever_has_the_tool() -> None:
    world = uncovered(("2",))

    def work(robot: str, tool: str, seconds: float) -> tuple[float, ...]:
        go_on(world, seconds, **{robot: using(above(world, "part_2", robot), tool)})
        done = world.senses(robot).at_tip.done  # type: ignore[union-attr]
        put(world, robot, 0, -3, 0)
        return done

    assert work("A1", "wires", 3) == (0.0, 1.0, 1.0), "nothing to do yet"
    half = work("A1", "hardware", 1.0)
    assert 0.4 < half[0] < 0.6
    assert half[1:] == (0.0, 0.0), "a new one has no wires"
    # The next one goes on where the first one stopped.
    assert work("A2", "hardware", 1.2)[0] == 1.0
    assert not world.parts["2"].is_broken
    assert work("B1", "solder", 4)[2] == 0.0, "not before its wires"
    assert work("B1", "wires", 3.2)[1] == 1.0
    assert work("A1", "solder", 4)[2] == 0.0, "it has no soldering iron"
    assert work("B1", "solder", 3.2) == (1.0, 1.0, 1.0)
    assert [event["what"].partition(" by ")[0] for event in world.events] == [
        "the cover is off",
        "part 2: hardware done",
        "part 2: wires done",
        "part 2: solder done",
    ]


def test_two_at_the_same_wires_are_twice_as_fast() -> None:
    alone, together = uncovered(("2",)), uncovered(("2",))
    for each in (alone, together):
        each.parts["2"].worked("hardware", 1.0)
    go_on(alone, 0.8, A1=using(above(alone, "part_2", "A1"), "wires"))
    first = using(above(together, "part_2", "A1"), "wires")
    put(together, "A2", 1.1, -0.4, math.pi, arm=0.45)
    go_on(together, 0.8, A1=first, A2=Command(arm_m=0.45, tool="wires"))
    done = alone.parts["2"].done["wires"]
    assert together.parts["2"].done["wires"] == pytest.approx(2 * done, rel=0.02)


# -- driving -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("robot", "speed"), [("A1", 1.2), ("C1", 1.0)])
def test_a_base_keeps_its_limits(world: World, robot: str, speed: float) -> None:
    put(world, robot, -5, -3, 0)
    go_on(world, 0.4, **{robot: Command(forward=9.0)})
    assert world.senses(robot).forward < 0.7, "it takes its time"
    go_on(world, 2, **{robot: Command(forward=9.0)})
    assert world.senses(robot).forward == pytest.approx(speed, rel=0.02)
    assert KINDS[robot[0]].speed == speed


def test_a_robot_that_says_nothing_more_stops(world: World) -> None:
    go_on(world, 1, A1=Command(forward=1.0))
    world.advance_to(world.time_s + 1.5)
    senses = world.senses("A1")
    assert math.hypot(senses.forward, senses.left) < 0.01
    at = senses.x
    world.advance_to(world.time_s + 2)
    assert world.senses("A1").x == pytest.approx(at, abs=1e-3)


def test_robots_do_not_pass_through_the_vehicle_or_one_another(world: World) -> None:
    put(world, "A1", 0, -1.5, math.pi / 2)
    go_on(world, 3, A1=Command(forward=1.0))
    assert world.senses("A1").y == pytest.approx(-0.9 - 0.28, abs=0.02)
    put(world, "A1", 3, -3, 0)
    put(world, "A2", 3.8, -3, math.pi)
    go_on(world, 3, A1=Command(forward=1.0), A2=Command(forward=1.0))
    assert world.senses("A2").x - world.senses("A1").x == pytest.approx(0.56, abs=0.02)


def test_a_big_robot_pushes_a_dead_one_out_of_its_way(world: World) -> None:
    put(world, "C1", -4, -3, 0)
    put(world, "A1", -3, -3, 0)
    go_on(world, 3, C1=Command(forward=0.8))
    assert world.senses("A1").x > -2.3


def test_the_range_finder_agrees_with_geometry(world: World) -> None:
    put(world, "A1", 0.0, -2.0, math.pi / 2)
    ranges = world.senses("A1").ranges_m
    # Ahead the vehicle, behind the south wall, beside another robot.
    assert ranges[0] == pytest.approx(2.0 - 0.9, abs=1e-6)
    assert ranges[20] == pytest.approx(4.0 - 2.0, abs=1e-6)
    put(world, "A2", 1.5, -2.0, 0)
    assert world.senses("A1").ranges_m[30] == pytest.approx(1.5 - 0.28, abs=1e-6)
    assert world.senses("A1").ranges_m[10] == 4.0


# -- the world ---------------------------------------------------------------------------------


def test_the_same_commands_make_the_same_world_to_the_bit() -> None:
    def state() -> bytes:
        world = World()
        go_on(world, 3, A1=Command(forward=1, turn=0.7), A2=Command(forward=1), C1=lift())
        return bytes(world.data.qpos.tobytes() + world.data.qvel.tobytes())

    assert state() == state()


def test_in_how_many_steps_somebody_looks_makes_no_difference() -> None:
    one, many = World(), World()
    for each in (one, many):
        each.exchange("A1", Command(forward=1.0))
    one.advance_to(2.0)
    for step in range(1, 401):
        many.advance_to(step * 0.005)
    assert np.array_equal(one.data.qpos, many.data.qpos)
    many.advance_to(1.0)
    assert many.time_s == pytest.approx(2.0), "never back"


def test_the_judge_of_an_untouched_vehicle(world: World) -> None:
    judged = world.judged()
    assert judged["problems"] == [
        "part 2 is broken",
        "part 2 lacks hardware",
        "part 4 is broken",
        "part 4 lacks hardware",
    ]
    assert not judged["mended"]
    assert World(()).judged()["mended"], "nothing was broken"
    without_screws(world)
    assert "screw 3 is not in" in world.judged()["problems"]


def test_there_are_five_parts() -> None:
    with pytest.raises(InputError, match="parts are 1, 2, 3, 4, 5, not 2, 7"):
        World(("2", "7"))


def test_the_mission_knows_the_same_places_as_the_model(world: World) -> None:
    parameters: Any = load_mission(mission_file("workshop")).parameters
    for name, place in parameters["map"]["places"].items():
        assert place["at"] == pytest.approx(world.data.site(f"part_{name}").xpos[:2])
    for number, at in enumerate(parameters["screws"], 1):
        assert at == pytest.approx(world.data.site(f"screw_{number}").xpos[:2])
        assert at == pytest.approx(world.data.site(f"hole_{number}").xpos[:2])
    for robot, at in parameters["map"]["stations"].items():
        assert at == pytest.approx(world.data.body(f"{robot}/base").xpos[:2])
    assert parameters["cover"]["off"] == world.data.body("rest").xpos[1]


def test_senses_of_a_small_robot_know_no_fork(world: World) -> None:
    found: Senses = world.senses("A1")
    assert found.fork is None
    assert Senses.read(found.plain()) == found
