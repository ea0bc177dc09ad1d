"""Continues a recording in the simulator from a given time, with other faults.

`ASSUMED`: what a recording does not contain, and is assumed.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from mrbt_mesh.core.facts.records import Claim, NoClaim, Phase
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.facts.team_facts import TeamFacts, changed_performances
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.recording.player import Player
from mrbt_mesh.recording.reader import Recording, RecordingError
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.sim.run import SimulationResult, simulate
from mrbt_mesh.sim.world.faults import ChangePerformance, Fault, Lose
from mrbt_mesh.sim.world.setup import Beginning

# In the simulator the team joins first; that time is not counted.
JOIN_US = 300_000
ASSUMED = (
    "all robots know the same facts: those of this recording",
    "robots that are alive join anew, within 0.3 s that are not counted, and plan anew",
    "work under way continues if the same robot gets it again, else it starts anew",
    "robots work as the program's simulation does; the network loses nothing",
)


@dataclass(frozen=True)
class Continuation:
    """The simulated continuation from `at_us` of the recording; times of `result` begin at 0.

    `under_way`: robot -> the local task that it had then.
    """

    at_us: int
    under_way: dict[str, str]
    result: SimulationResult

    def recorded_us(self, simulated_us: int) -> int:
        """A time of the result as one of the recording."""
        return self.at_us + max(0, simulated_us - JOIN_US)


def what_if(
    recording: Recording,
    at_us: int,
    program: RobotProgram,
    faults: Iterable[tuple[int, Fault]],
    *,
    seed: int = 0,
    timeout_us: int,
) -> Continuation:
    """Go on from a time of the recording; faults have times of the recording, not before `at_us`.

    Raises RecordingError if no robot is alive then or the recording is damaged, ValueError for
    faults of robots that the mission does not have, SimulationError.
    """
    player = Player(recording)
    player.seek(at_us)
    facts, mission = player.state.facts, player.mission
    robots = sorted(robot for robot in player.state.alive if robot in mission.robots)
    if not robots:
        raise RecordingError(f"{recording.path}: no robot of the mission is alive at that time")
    running = _running(player, at_us)
    schedule = [(JOIN_US + each_us - at_us, fault) for each_us, fault in faults]
    result = simulate(
        mission,
        program,
        seed=seed,
        robots=robots,
        schedule=sorted([*_described(mission, facts, robots), *schedule], key=lambda each: each[0]),
        timeout_us=JOIN_US + timeout_us,
        speed=recording.metadata.speed,
        inspect=False,
        begin=Beginning(
            recording.metadata.run,
            _kept(facts),
            {
                (robot, claim.activation, claim.local_task): elapsed_us
                for robot, (claim, elapsed_us) in running.items()
            },
        ),
    )
    under_way = {robot: claim.local_task for robot, (claim, _) in running.items()}
    return Continuation(at_us, under_way, result)


def _running(player: Player, at_us: int) -> dict[str, tuple[Claim, int]]:
    """Robot -> the claim that it runs, and for how long it has."""
    claims = player.observer.record.claims
    found: dict[str, tuple[Claim, int]] = {}
    for since_us, robot, claim in claims:
        now = player.state.facts.valid_claim(robot)
        if claim == now and claim.phase is Phase.RUNNING and robot in player.state.alive:
            found[robot] = (claim, at_us - since_us)
    return found


def _kept(facts: TeamFacts) -> tuple[Entry, ...]:
    """The facts that robots know when they start: all but claims."""
    return tuple(e for e in facts.map if not isinstance(e.record, Claim | NoClaim))


def _described(
    mission: Mission, facts: TeamFacts, robots: Iterable[str]
) -> Iterable[tuple[int, Fault]]:
    """The capabilities that robots had lost, and performances that had changed."""
    for robot in robots:
        known = facts.members.get(robot)
        if known is None:
            continue
        for name, reason in known.member.lost.items():
            yield 0, Lose(robot, name, reason)
        for name, value in changed_performances(mission, robot, known.member).items():
            yield 0, ChangePerformance(robot, name, value)
