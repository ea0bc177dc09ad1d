"""Continues a recording in the simulator from a given time, with other faults.

`ASSUMED` lists what a recording does not contain and is assumed.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from mrbt_mesh.core.agent.config import ResumedLife
from mrbt_mesh.core.facts.records import Phase
from mrbt_mesh.core.facts.store import Incarnation, Version
from mrbt_mesh.core.planning.deadlines import Deadlines, Due
from mrbt_mesh.recording.player import Player
from mrbt_mesh.recording.reader import Recording, RecordingError
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.sim.run import SimulationResult, simulate
from mrbt_mesh.sim.world.faults import Fault, Restart
from mrbt_mesh.sim.world.setup import LAUNCH_UNIX_US, Beginning
from mrbt_mesh.views.replay.recorded_course import RecordedCourse

ASSUMED = (
    "all robots know the same facts: those of this recording",
    "work that a robot did in the recording takes as long and ends as it did there",
    "other work, and all that programs do beside work, is as their simulation has it",
    "the network loses nothing",
)


@dataclass(frozen=True)
class Continuation:
    """The simulated continuation from `at_us` of the recording; times of `result` begin at 0.

    `under_way`: robot -> its local task at that time. `recorded`: the recording at its end.
    """

    at_us: int
    under_way: dict[str, str]
    result: SimulationResult
    recorded: Player

    def recorded_us(self, simulated_us: int) -> int:
        """Convert a time of the result to one of the recording."""
        return self.at_us + simulated_us


def what_if(
    recording: Recording,
    at_us: int,
    program: RobotProgram,
    faults: Iterable[tuple[int, Fault]] = (),
    *,
    without_recorded: bool = False,
    seed: int = 0,
    timeout_us: int,
) -> Continuation:
    """Continue from a time of the recording.

    Faults have times of the recording, not before `at_us`. Those of the recording happen too,
    unless `without_recorded`. Raises RecordingError if no robot is alive then or the recording is
    damaged, ValueError for faults of robots that the mission does not have, and SimulationError.
    """
    recorded, player = Player(recording), Player(recording)
    course = RecordedCourse(recorded)
    deadlines_us = _deadlines(player, at_us)
    state, mission = player.state, player.mission
    lives = {
        robot: _resumed(player, robot, life, deadlines_us)
        for robot, life in sorted(state.alive.items())
        if robot in mission.robots
    }
    if not lives:
        raise RecordingError(f"{recording.path}: no robot of the mission is alive at that time")
    schedule = [*faults, *course.deaths_to_notice(at_us)]
    if not without_recorded:
        schedule += course.faults_from(at_us)
        # Also robots that were about to join.
        schedule += [
            (at_us, Restart(robot))
            for robot, known in state.robots.items()
            if robot not in state.alive and known["state"] == "alive" and not known["joined"]
        ]
    result = simulate(
        mission,
        program,
        seed=seed,
        robots=lives,
        schedule=sorted(
            ((each_us - at_us, fault) for each_us, fault in schedule), key=lambda each: each[0]
        ),
        timeout_us=timeout_us,
        speed=recording.metadata.speed,
        inspect=False,
        begin=Beginning(
            recording.metadata.run,
            tuple(state.facts.map),
            lives,
            course.works_from(at_us),
            course.answer,
            course.ways_at(at_us),
            (recording.metadata.epoch_ns // 1_000 or LAUNCH_UNIX_US) + at_us,
        ),
    )
    claims = {robot: state.facts.valid_claim(robot) for robot in lives}
    running = {r: c for r, c in claims.items() if c is not None and c.phase is Phase.RUNNING}
    under_way = {robot: claim.local_task for robot, claim in running.items()}
    return Continuation(at_us, under_way, result, recorded)


def _deadlines(player: Player, at_us: int) -> dict[Due, int]:
    """Play to a time; return the remaining times of the deadlines that run then."""
    timing, plan = player.recording.metadata.timing, None
    deadlines = Deadlines(timing.detection_us, timing.failure_latch_us)
    for _ in player.play_to(at_us):
        if player.observer.plan is not plan:
            plan = player.observer.plan
            if plan is not None:
                deadlines.expired(plan, player.state.facts, player.now_us, lambda: False)
    return deadlines.left_us(at_us)


def _resumed(
    player: Player, robot: str, life: Incarnation, deadlines_us: dict[Due, int]
) -> ResumedLife:
    facts, plan = player.state.facts, player.observer.plan
    written = [
        e.version.sequence for e in facts.map.of_author(robot) if e.version.incarnation == life
    ]
    assignment = plan.assignments.get(robot) if plan is not None else None
    partners = plan.partners(robot) if plan is not None and assignment is not None else ()
    version = Version(life, max(written, default=0) + 1)
    return ResumedLife(version, assignment, partners, deadlines_us)
