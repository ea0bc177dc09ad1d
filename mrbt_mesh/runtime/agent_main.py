"""`mrbt agent`: one robot, anywhere on the network.

It parses its own arguments: a robot's process imports neither the other commands nor, given a
compiled mission, the mission format.
"""

from __future__ import annotations

import argparse
import gc
import os
import secrets
import socket
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from mrbt_mesh import __version__
from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.core.mission.mission import Mission, is_robot_id
from mrbt_mesh.errors import InputError
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.driver import Driver, RobotSetup
from mrbt_mesh.runtime.engine_choice import chosen_engine
from mrbt_mesh.runtime.journal import Journal, journal_path
from mrbt_mesh.runtime.log import configure_log, robot_logger
from mrbt_mesh.runtime.program_loader import check_program, load_program
from mrbt_mesh.runtime.run_dir import RunDir
from mrbt_mesh.runtime.settings import (
    DEFAULT_BEAT_S,
    DEFAULT_DETECTION_S,
    MISSION_VARIABLE,
    PROTOCOLS,
    RUN_VARIABLE,
    TEAM_VARIABLE,
    WIRED,
)
from mrbt_mesh.runtime.solver_loader import solver_for
from mrbt_mesh.runtime.solver_process import SolverProcess
from mrbt_mesh.runtime.team_address import on_network

# A robot that is the first of its team to be there waits so long for the others to start.
DEFAULT_GATHER_S, MAX_GATHER_S = 10.0, 86_400.0
# From so many on, planning may take longer than the event loop may stand still.
LARGE_ROBOTS = 100
LARGE_NODES = 2_000

EXAMPLE = """\
example, two robots on two machines that find each other by multicast:
  mrbt agent --mission examples/explore/mission.yaml --robot R1
  mrbt agent --mission examples/explore/mission.yaml --robot R2

The variables MRBT_MISSION, MRBT_TEAM and MRBT_RUN stand for the options of these names.

exit status: 0 mission succeeded or left on purpose, 1 mission failed, 2 bad input or refused
"""


def parser() -> argparse.ArgumentParser:
    """The arguments of `mrbt agent`."""
    result = argparse.ArgumentParser(
        prog="mrbt agent",
        description="Run one robot, anywhere on the network.",
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = result.add_argument
    variable = os.environ.get
    mission = variable(MISSION_VARIABLE)
    text = "mission file, or a compiled mission (.json)"
    add("--mission", type=Path, required=mission is None, default=mission, help=text)
    add("--robot", required=True, help="this robot's id")
    add("--type", help="robot type, for a robot that the mission file does not list")
    add("--program", help="robot program FILE.py[:NAME]; default: the mission's")
    text = (
        "min_cost_flow, cp_sat, brute_force, or your own (docs/solvers.md); default: the mission's"
    )
    add("--solver", metavar="NAME", help=text)
    text = "name of the team on the network; default: the mission's name"
    add("--team", default=variable(TEAM_VARIABLE), help=text)
    text = "run id; robots of different runs ignore each other; default: one of the mission"
    add("--run", default=variable(RUN_VARIABLE), help=text)
    add("--expect", help="robots to hear before starting, A1,B1; default: all of the mission")
    text = f"wait so long for them, in s, while no team is there (default {DEFAULT_GATHER_S:g})"
    add("--gather", type=float, default=DEFAULT_GATHER_S, help=text)
    transport = "wired: TCP (default); wireless: QUIC, for lossy networks, needs --key"
    add("--transport", choices=tuple(PROTOCOLS), default=WIRED, help=transport)
    add("--key", type=Path, help="the team's key, made by `mrbt key FILE`")
    endpoint = "endpoint to listen on, tcp/IP:PORT, or quic/IP:PORT if wireless"
    add("--listen", action="append", default=[], help=endpoint)
    add("--connect", action="append", default=[], help="endpoint of another robot to dial")
    add("--multicast", help="interface for discovery; default: auto, unless endpoints are given")
    add("--run-dir", type=Path, help="folder for the log and for events.jsonl")
    text = f"heartbeat period in s (default {DEFAULT_BEAT_S})"
    add("--beat", type=float, default=DEFAULT_BEAT_S, help=text)
    text = f"silence until dead in s (default {DEFAULT_DETECTION_S})"
    add("--detection", type=float, default=DEFAULT_DETECTION_S, help=text)
    add("--speed", type=float, default=1.0, help="simulated robots work this much faster")
    add("--takeover", action="store_true", help="replace a live robot of the same id")
    add("--exit-when-done", action="store_true", help="stop once the team has the result")
    return result


def robot_of(mission: Mission, robot: str, kind: str | None) -> tuple[str, Mapping[str, int]]:
    """(type, capabilities) of a robot; raises InputError where the mission lacks it."""
    if not is_robot_id(robot):
        raise InputError(f"robot id {robot!r}: 1 to 32 letters, digits, '_' or '-'")
    known = mission.robots.get(robot)
    if known is not None and kind in (None, known.type):
        return known.type, known.capabilities
    if kind is None:
        listed = ", ".join(mission.robots)
        raise InputError(
            f"mission {mission.name} has no robot {robot!r} (it has {listed}); "
            "name its --type to add it"
        )
    if kind not in mission.robot_types:
        listed = ", ".join(sorted(mission.robot_types))
        raise InputError(f"mission {mission.name} has no robot type {kind!r} ({listed})")
    return kind, mission.robot_types[kind]


def make_driver(options: argparse.Namespace) -> Driver:
    """Put a robot together.

    Raises InputError or ValueError.
    """
    mission = load_mission(options.mission)
    kind, capabilities = robot_of(mission, options.robot, options.type)
    reference = options.program or mission.program
    if reference is None:
        raise InputError(f"mission {mission.name} names no program: give one with --program")
    program = load_program(reference)
    lacking = check_program(program, mission, capabilities)
    if lacking:
        raise InputError(f"{reference} has no {', no '.join(lacking)} for type {kind}")
    address = on_network(
        mission,
        robot=options.robot,
        team=options.team,
        run=options.run,
        listen=options.listen,
        connect=options.connect,
        multicast=options.multicast,
        beat_s=options.beat,
        detection_s=options.detection,
        profile=options.transport,
        key=options.key,
    )
    journal = open_journal(options.run_dir, mission, address.run, options.robot)
    if not 0 <= options.gather <= MAX_GATHER_S:
        raise InputError(f"--gather {options.gather:g}: 0 to {MAX_GATHER_S:g} s")
    expected = options.expect.split(",") if options.expect else list(mission.robots)
    solver = solver_for(mission, options.solver)
    is_large = len(mission.robots) >= LARGE_ROBOTS or len(mission.tree.nodes) >= LARGE_NODES
    config = AgentConfig(
        robot=options.robot,
        type=kind,
        capabilities=dict(capabilities),
        run=address.run,
        nonce=secrets.token_hex(4),
        solver=SolverProcess(solver) if is_large else solver,
        plans_apart=is_large,
        engine=chosen_engine(),
        timing=address.timing,
        expected=frozenset(expected),
        gather_us=round(options.gather * SECOND_US),
        takeover=options.takeover,
        exit_when_done=options.exit_when_done,
        software=__version__,
        host=socket.gethostname(),
        pid=os.getpid(),
        restored=journal.open() if journal is not None else (),
    )
    setup = RobotSetup(
        mission, config, address.transport, program, options.speed, options.run_dir, journal
    )
    return Driver(setup)


def open_journal(run_dir: Path | None, mission: Mission, run: str, robot: str) -> Journal | None:
    """The robot's journal in its run directory, not yet opened; None without a directory."""
    if run_dir is None:
        return None
    logger = robot_logger(robot)

    def log(level: str, event: str, **fields: Any) -> None:
        getattr(logger, level)(event, **fields)

    return Journal(journal_path(run_dir, robot), mission.digest, run, robot, log)


def claim_run_dir(run_dir: Path, robot: str, takeover: bool) -> None:
    """Make this process the robot of the run directory; raises InputError if one runs."""
    run_dir.mkdir(parents=True, exist_ok=True)
    found = RunDir(run_dir)
    running = found.process(robot)
    # In a container that was started again, the last life may have had this very pid.
    if running is not None and running.pid != os.getpid() and not takeover:
        raise InputError(
            f"robot {robot} is already running here (pid {running.pid}): stop it first, "
            "or start with --takeover to replace it"
        )
    found.write_process(robot)


def main(arguments: Sequence[str]) -> NoReturn:
    """Run one robot; ends the process itself, since a Zenoh session may take 10 s to close."""
    options = parser().parse_args(arguments)
    message = ""
    try:
        if options.run_dir is not None:
            claim_run_dir(options.run_dir, options.robot, options.takeover)
        configure_log(options.robot, options.run_dir)
        driver = make_driver(options)
        # What is there for good is not looked through in every collection: of a large mission
        # that would take longer than a robot should be deaf.
        gc.collect()
        gc.freeze()
        stop = driver.run()
        code = stop.code
        if code == 2 or options.run_dir is None:
            message = f"{options.robot}: {stop.reason}"
    except (InputError, OSError, ValueError) as error:
        code, message = 2, str(error)
    if message:
        sys.stderr.write(f"mrbt agent: {message}\n")
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)
