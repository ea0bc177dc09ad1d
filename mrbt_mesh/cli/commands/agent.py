"""`mrbt agent`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from mrbt_mesh.cli.framework.declare import Given, option
from mrbt_mesh.cli.options import (
    KeepOption,
    ProgramOption,
    RecordBeatsOption,
    SolverOption,
    SpeedOption,
)
from mrbt_mesh.cli.team.metrics_options import MetricsOptions
from mrbt_mesh.cli.team.network_options import TeamNetworkOptions, warn_insecure
from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.settings import DEFAULT_GATHER_S, DEFAULT_KEEP_MIB, MIB, MISSION_VARIABLE


@dataclass(frozen=True)
class RobotOptions:
    """Which robot it is, and what it does."""

    mission: Annotated[
        Path,
        option("Mission file, or a compiled one (.json).", "FILE", variable=MISSION_VARIABLE),
    ]
    robot: Annotated[str, option("This robot's id.", "ID")]
    robot_type: Annotated[
        str | None,
        option("Its type, if the mission does not list it.", "TYPE", name="--type"),
    ] = None
    program: ProgramOption = None
    solver: SolverOption = None
    speed: SpeedOption = 1.0
    run_dir: Annotated[Path | None, option("Folder for journal, log and events.", "DIR")] = None
    record: Annotated[
        Path | None, option("Record what it knows and does; docs/recording.md.", "FILE.mcap")
    ] = None
    record_beats: RecordBeatsOption = False
    keep: KeepOption = DEFAULT_KEEP_MIB
    takeover: Annotated[bool, option("Replace a live robot of the same id.")] = False
    exit_when_done: Annotated[bool, option("Stop once the team has the result.")] = False
    while_locked: Annotated[
        Path | None,
        option("Leave once nobody holds a lock (flock) on it, as a launcher does.", "FILE"),
    ] = None
    insecure: Annotated[
        bool, option("Without --keys: whoever reaches the robot's port may say anything.")
    ] = False


@dataclass(frozen=True)
class StartOptions:
    """When it begins."""

    expect: Annotated[
        str | None,
        option("Robots to hear before starting. Default: all of the mission.", "A1,B1,..."),
    ] = None
    gather: Annotated[
        float,
        option("Wait so long for them while no team is there.", "SECONDS", least=0, most=86_400),
    ] = DEFAULT_GATHER_S


def agent(
    *,
    robot: RobotOptions,
    start: StartOptions,
    listen: Annotated[
        tuple[str, ...],
        option("Endpoint to listen on; quic/IP:PORT if it is wireless.", "tcp/IP:PORT"),
    ] = (),
    network: TeamNetworkOptions,
    metrics: MetricsOptions,
    given: Given,
) -> None:
    """Run one robot, anywhere on the network.

    Exit status: 0 the mission succeeded or the robot left on purpose, 1 the mission failed, 2 bad
    input or refused.

    Example, two robots on two machines that find each other by multicast:

    mrbt agent --mission examples/explore/mission.yaml --keys keys --robot R1

    mrbt agent --mission examples/explore/mission.yaml --keys keys --robot R2
    """
    from functools import partial

    from mrbt_mesh.runtime.robot_process import RobotStart, run_robot

    if robot.insecure:
        given.refuse(["--keys"], "with --insecure nothing is signed")
        warn_insecure()
    elif network.keys is None:
        raise InputError(
            "without keys nobody knows who says what: give --keys DIR, once made with "
            f"`mrbt keys init DIR --robots {robot.robot},...` and copied to every robot, "
            "or --insecure to believe whoever reaches this robot's port"
        )
    if robot.record is None:
        given.refuse(["--record-beats"], "of a recording: give --record as well")
    wanted = RobotStart(
        robot.mission,
        robot.robot,
        type=robot.robot_type,
        program=robot.program,
        solver=robot.solver,
        speed=robot.speed,
        run_dir=robot.run_dir,
        takeover=robot.takeover,
        exit_when_done=robot.exit_when_done,
        while_locked=robot.while_locked,
        record=robot.record,
        record_beats=robot.record_beats,
        keep_bytes=robot.keep * MIB,
        expect=tuple(start.expect.split(",")) if start.expect is not None else None,
        gather_s=start.gather,
        metrics=metrics.address(given),
    )
    run_robot(wanted, partial(network.locate, robot=robot.robot, listen=listen))
