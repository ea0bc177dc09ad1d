"""`mrbt sim`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from mrbt_mesh.cli.exporting import RunFileOptions
from mrbt_mesh.cli.framework.declare import Given, option
from mrbt_mesh.cli.options import (
    JsonOption,
    OptionalMissionArgument,
    ProgramOption,
    RobotsOption,
    SeedOption,
    SolverOption,
    SpeedOption,
    VirtualTimeoutOption,
)
from mrbt_mesh.errors import InputError

if TYPE_CHECKING:
    from mrbt_mesh.sim.world.network import NetworkKnobs

_fault = partial(option, panel="What befalls the team")
_network = partial(option, panel="The network")
_chance = partial(_network, least=0, most=1, step=0.001)
_delay = partial(_network, least=0, step=0.001)
Faults = tuple[str, ...]
FILES = ("--events", "--log", "--record", "--btlog", "--py-trees-js")


@dataclass(frozen=True)
class SimRunOptions:
    """Who works how, and for how long."""

    seed: SeedOption = 0
    robots: RobotsOption = None
    program: ProgramOption = None
    solver: SolverOption = None
    timeout: VirtualTimeoutOption = 600.0
    speed: SpeedOption = 1.0


@dataclass(frozen=True)
class NamedFaultOptions:
    """What happens to which robot, when."""

    kill: Annotated[Faults, _fault("SIGKILL; repeat it, or use commas.", "A1@12.5,...")] = ()
    restart: Annotated[Faults, _fault("Start it again, or one more.", "A1@14,...")] = ()
    freeze: Annotated[Faults, _fault("SIGSTOP.", "A1@3,...")] = ()
    thaw: Annotated[Faults, _fault("SIGCONT.", "A1@8,...")] = ()
    leave: Annotated[Faults, _fault("Leave on purpose.", "B1@6,...")] = ()
    fault: Annotated[
        Faults, _fault("Lose a capability, or all of them.", "A1:LOCAL_TASK@4,...")
    ] = ()
    restore: Annotated[Faults, _fault("Have it again.", "A1[:LOCAL_TASK]@6,...")] = ()
    performance: Annotated[
        Faults, _fault("Do it better or worse from then on.", "A1:LOCAL_TASK=0.5@4,...")
    ] = ()


@dataclass(frozen=True)
class NetworkOptions:
    """How the network treats messages."""

    loss: Annotated[float, _chance("Share of messages that are lost.")] = 0.0
    duplicate: Annotated[float, _chance("Share of messages that come twice.")] = 0.0
    reorder: Annotated[float, _chance("Share of messages overtaken by others.")] = 0.0
    delay_ms: Annotated[float, _delay("Time that a message takes.")] = 1.0
    jitter_ms: Annotated[float, _delay("Up to this much more.")] = 1.0

    def knobs(self) -> NetworkKnobs:
        """The same for the simulator."""
        from mrbt_mesh.sim.world.network import LinkKnobs, NetworkKnobs

        return NetworkKnobs(
            LinkKnobs(
                delay_us=round(self.delay_ms * 1_000),
                jitter_us=round(self.jitter_ms * 1_000),
                loss_permille=round(self.loss * 1_000),
                duplicate_permille=round(self.duplicate * 1_000),
                reorder_permille=round(self.reorder * 1_000),
            )
        )


def sim(
    *,
    mission: OptionalMissionArgument = None,
    run: SimRunOptions,
    faults: NamedFaultOptions,
    network: NetworkOptions,
    schedule: Annotated[
        Path | None, option("Replay the faults and the network that mrbt chaos wrote.", "FILE")
    ] = None,
    files: RunFileOptions,
    as_json: JsonOption = False,
    given: Given,
) -> None:
    """Run a mission once in virtual time, with the faults that you name.

    Seconds of work take milliseconds, and the same options give the same run, to the byte. The
    agents and your robots' own code are the real ones; what must always hold is checked. Many runs
    with random faults: `mrbt chaos`. How likely the mission succeeds: `mrbt estimate`. Times count
    from the launch of the team.

    Exit status: 0 the mission succeeded, 1 it failed or an invariant broke, 2 bad input, 3 not
    finished in time or blocked at the end. Of a mission that never ends, its last round that has
    ended by --timeout.

    Example: mrbt sim examples/vehicle_repair/mission.yaml --seed 7 --kill A1@12.5
    --freeze B1@3 --thaw B1@8 --loss 0.1

    Example: mrbt sim --schedule chaos-failures/seed-17-minimised.json
    """
    from mrbt_mesh.cli.missions import checked_program, chosen_robots
    from mrbt_mesh.cli.virtual.named_faults import read_faults
    from mrbt_mesh.cli.virtual.one_run import run_and_tell
    from mrbt_mesh.cli.virtual.replay import read_schedule
    from mrbt_mesh.formats.mission_file import load_mission
    from mrbt_mesh.runtime.program_loader import load_program
    from mrbt_mesh.runtime.solver_loader import solver_for
    from mrbt_mesh.sim.run import run_scenario, simulate
    from mrbt_mesh.sim.world.named_faults import check_faults
    from mrbt_mesh.sim.world.setup import AgentOptions

    files.check(mission)
    tell = partial(run_and_tell, files=files, as_json=as_json)
    if schedule is not None:
        own = ("MISSION", "--schedule", "--program", *FILES, "--json")
        given.refuse_all_but(own, "not beside --schedule, whose file says it")
        read = read_schedule(schedule, mission, run.program)
        tell(partial(run_scenario, *read), read[0], ())
    if mission is None:
        raise InputError("give a MISSION, or the --schedule of a run to replay")
    loaded = load_mission(mission)
    team = chosen_robots("--robots", run.robots, loaded)
    named = read_faults(loaded, {f"--{kind}": texts for kind, texts in vars(faults).items()})
    check_faults(named, team, run.timeout)
    once = partial(
        simulate,
        loaded,
        load_program(checked_program(loaded, team, run.program)),
        seed=run.seed,
        robots=team,
        schedule=[(fault.at_us, fault.fault) for fault in named],
        network=network.knobs(),
        timeout_us=round(run.timeout * 1e6),
        speed=run.speed,
        agents=AgentOptions(solver=solver_for(loaded, run.solver)),
    )
    tell(once, loaded, named)
