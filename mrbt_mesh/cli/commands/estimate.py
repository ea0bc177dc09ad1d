"""`mrbt estimate`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated

from mrbt_mesh.cli.framework.declare import Given, option
from mrbt_mesh.cli.options import (
    JobsOption,
    JsonOption,
    MissionArgument,
    ProgramOption,
    SeedOption,
    SpeedOption,
    VirtualTimeoutOption,
)

if TYPE_CHECKING:
    from mrbt_mesh.core.mission.mission import Mission
    from mrbt_mesh.sim.world.setup import FailureModel

_fault = partial(option, panel="What befalls the team")
_seconds = partial(_fault, metavar="SECONDS", above=0)


@dataclass(frozen=True)
class ChanceOptions:
    """What goes wrong how often."""

    fault_rate: Annotated[
        tuple[str, ...],
        _fault(
            "Robots die: a chance per completed action, or a number per hour.",
            "[WHO:]P[/action|/hour]",
        ),
    ] = ()
    minor_rate: Annotated[
        tuple[str, ...],
        _fault("Robots lose a capability, likewise.", "[WHO:]P[/action|/hour]"),
    ] = ()
    failure_rate: Annotated[
        tuple[str, ...], _fault("Actions fail with this chance.", "[LOCAL_TASK:]P")
    ] = ()
    major: Annotated[int, _fault("So many robots die, at random times.", least=0)] = 0
    minor: Annotated[int, _fault("So many capabilities are lost, at random times.", least=0)] = 0
    within: Annotated[
        float | None,
        _seconds(
            "The time for --major and --minor. Default: as long as an undisturbed mission takes."
        ),
    ] = None
    return_after: Annotated[float | None, _seconds("Dead robots are started again.")] = None
    repair_after: Annotated[float | None, _seconds("Lost capabilities come back.")] = None

    def model(self, mission: Mission, given: Given) -> FailureModel:
        """The same for the simulator; raises InputError, also for options without effect."""
        from mrbt_mesh.cli.virtual.settings import check_counts, parse_chances, parse_rates
        from mrbt_mesh.sim.world.setup import FailureModel

        check_counts(mission, self.major, self.minor)
        if not self.major and not self.minor:
            given.refuse(["--within"], "for --major and --minor, of which there are none")
        if not self.major and not self.fault_rate:
            given.refuse(["--return-after"], "no robot dies: see --fault-rate and --major")
        if not self.minor and not self.minor_rate:
            given.refuse(["--repair-after"], "no capability is lost: see --minor-rate and --minor")
        return FailureModel(
            major=parse_rates("fault-rate", self.fault_rate, mission),
            minor=parse_rates("minor-rate", self.minor_rate, mission),
            actions=parse_chances("failure-rate", self.failure_rate, mission),
            major_faults=self.major,
            minor_faults=self.minor,
            within_us=_microseconds(self.within) or 0,
            return_us=_microseconds(self.return_after),
            repair_us=_microseconds(self.repair_after),
        )


def _microseconds(seconds: float | None) -> int | None:
    return None if seconds is None else max(1, round(seconds * 1e6))


@dataclass(frozen=True)
class EstimateOptions:
    """Which runs are made, and how many."""

    runs: Annotated[int, option("Number of runs.", least=1)] = 1_000
    seed: SeedOption = 0
    jobs: JobsOption = None
    timeout: VirtualTimeoutOption = 600.0
    speed: SpeedOption = 1.0
    program: ProgramOption = None


def estimate(
    *,
    mission: MissionArgument,
    faults: ChanceOptions,
    which: EstimateOptions,
    as_json: JsonOption = False,
    given: Given,
) -> None:
    """Estimate how likely a mission succeeds and how long it takes when robots fail by chance.

    Makes many runs of the same agents in virtual time. A run that can never go on is ended early,
    as blocked. The same options and seed print the same figures, whatever --jobs. One run with
    faults that you name: `mrbt sim`.

    WHO is a robot or a robot type; without it, everybody.

    Exit status: 0 the runs were made, 1 an agent or a program broke, 2 bad input, 3 interrupted.

    Example: mrbt estimate examples/vehicle_repair/mission.yaml --fault-rate 0.05/action

    Example: mrbt estimate MISSION --fault-rate A:2/hour --minor-rate 0.1 --repair-after 30
    """
    import os

    from mrbt_mesh.cli.missions import checked_program
    from mrbt_mesh.cli.virtual.estimating import run_and_print
    from mrbt_mesh.formats.mission_file import load_mission
    from mrbt_mesh.sim.estimate import Experiment

    loaded = load_mission(mission)
    program = checked_program(loaded, sorted(loaded.robots), which.program)
    experiment = Experiment(
        str(mission),
        program,
        faults.model(loaded, given),
        which.runs,
        which.seed,
        which.speed,
        round(which.timeout * 1e6),
    )
    jobs = which.jobs or os.cpu_count() or 1
    run_and_print(experiment, loaded, jobs, as_json)
