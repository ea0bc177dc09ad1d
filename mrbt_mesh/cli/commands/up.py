"""`mrbt up`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from mrbt_mesh.cli.framework.declare import Given, option
from mrbt_mesh.cli.options import (
    KeepOption,
    MissionArgument,
    ProgramOption,
    RecordBeatsOption,
    RobotsOption,
    SolverOption,
    SpeedOption,
)
from mrbt_mesh.cli.team.page_options import PANEL, WebOptions
from mrbt_mesh.cli.team.show_options import ShowOptions
from mrbt_mesh.runtime.settings import DEFAULT_BEAT_S, DEFAULT_DETECTION_S, DEFAULT_KEEP_MIB


@dataclass(frozen=True)
class LaunchOptions:
    """What is started, and how its robots talk."""

    robots: RobotsOption = None
    program: ProgramOption = None
    solver: SolverOption = None
    speed: SpeedOption = 1.0
    run_dir: Annotated[Path | None, option("Folder for logs, events and the summary.", "DIR")] = (
        None
    )
    resume: Annotated[bool, option("Go on with the run in --run-dir, from its journals.")] = False
    detach: Annotated[bool, option("Start the team and leave it running without `up`.")] = False
    transport: Annotated[
        Literal["wired", "wireless"],
        option("How robots talk: TCP, or QUIC for lossy networks."),
    ] = "wired"
    router: Annotated[
        str | None,
        option("Routers to be clients of, in place of links to one another.", "tcp/IP:PORT,..."),
    ] = None
    no_record: Annotated[bool, option("Write no recordings; docs/recording.md.")] = False
    record_beats: RecordBeatsOption = False
    keep: KeepOption = DEFAULT_KEEP_MIB
    insecure: Annotated[
        bool, option("Without keys: whoever reaches a robot's port may say anything.")
    ] = False
    beat: Annotated[float, option("Heartbeat period.", "SECONDS", above=0, most=3600)] = (
        DEFAULT_BEAT_S
    )
    detection: Annotated[
        float, option("Silence until a robot is dead.", "SECONDS", above=0, most=3600)
    ] = DEFAULT_DETECTION_S
    metrics_port: Annotated[
        int | None,
        option(
            "Robots serve metrics for Prometheus, on this port and those that follow.",
            "PORT",
            least=1,
            most=65_535,
        ),
    ] = None


def up(
    *,
    mission: MissionArgument,
    launch: LaunchOptions,
    show: ShowOptions,
    web: Annotated[bool, option("Show the team in the browser too.", panel=PANEL)] = False,
    page: WebOptions,
    given: Given,
) -> None:
    """Start one process per robot and watch the mission.

    Exit status: 0 success, 1 failure, 2 bad input, 3 not finished in time, blocked, or ended
    before the team had gathered. A mission that never ends does so with --timeout, Ctrl-C or
    `mrbt abort`; the last round that has ended tells. When `up` is gone, also killed or with its
    terminal, its robots leave by themselves, unless it was --detach.

    Example: mrbt up examples/vehicle_repair/mission.yaml --speed 2
    """
    from mrbt_mesh import plugins
    from mrbt_mesh.cli.missions import checked_program, chosen_robots
    from mrbt_mesh.cli.team.launching import created, resumed, run_team
    from mrbt_mesh.cli.team.network_options import endpoints_of, warn_insecure
    from mrbt_mesh.formats.mission_file import load_mission
    from mrbt_mesh.runtime.solver_loader import solver_for
    from mrbt_mesh.runtime.team import new_run

    if launch.detach:
        given.refuse(
            ("--headless", "--json", "--timeout"),
            "with --detach nobody watches the run; see mrbt watch",
        )
        given.refuse(("--web",), "with --detach nobody watches the run; see mrbt web")
    if not web:
        given.refuse(("--port", "--host", "--control"), "of the live page: give --web as well")
    if launch.no_record:
        given.refuse(["--record-beats"], "with --no-record nothing is recorded")
    served = page.page() if web else None
    if launch.metrics_port is not None:
        plugins.metrics().check()
    loaded = load_mission(mission)
    robots = chosen_robots("--robots", launch.robots, loaded)
    program = checked_program(loaded, robots, launch.program)
    solver_for(loaded, launch.solver)
    info = new_run(
        loaded,
        mission,
        robots,
        program,
        beat_s=launch.beat,
        detection_s=launch.detection,
        speed=launch.speed,
        transport=launch.transport,
        solver=launch.solver,
        insecure=launch.insecure,
        routers=endpoints_of(launch.router),
        record=not launch.no_record,
        record_beats=launch.record_beats,
        keep_mib=launch.keep,
        metrics_port=launch.metrics_port,
    )
    if launch.insecure:
        warn_insecure()
    make = resumed if launch.resume else created
    run_team(make(launch.run_dir, info, loaded), loaded, None if launch.detach else show, served)
