"""One robot's process: assembles the agent with its driver, and runs it to its end.

With a compiled mission, it imports nothing of the mission format.
"""

from __future__ import annotations

import gc
import os
import secrets
import socket
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

from mrbt_mesh import plugins
from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.facts.records import NOT_ASKED
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import is_robot_id
from mrbt_mesh.errors import InputError
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.driver import BROKEN, BrokenRobotError, Driver, RobotSetup
from mrbt_mesh.runtime.journal import Journal, journal_path
from mrbt_mesh.runtime.launcher_lock import LauncherWatch
from mrbt_mesh.runtime.limited_file import protect_output
from mrbt_mesh.runtime.log import configure_log, robot_logger
from mrbt_mesh.runtime.program import RobotProgram, functions_of
from mrbt_mesh.runtime.program_loader import load_program, require_program
from mrbt_mesh.runtime.robot_options import RobotOptions
from mrbt_mesh.runtime.run_dir import RunDir
from mrbt_mesh.runtime.session_config import require_threads
from mrbt_mesh.runtime.solver_loader import chosen_engine, lacks_planner, solver_for
from mrbt_mesh.runtime.team_address import keys_of, on_network
from mrbt_mesh.version import __version__

# From these sizes on, planning may take longer than the event loop may block.
LARGE_ROBOTS = 100
LARGE_NODES = 2_000

NO_JOURNAL = "this robot keeps no journal, which exclusive tasks need: give it a run directory"


def robot_of(mission: Mission, robot: str, kind: str | None) -> tuple[str, Mapping[str, int]]:
    """Return (type, capabilities) of a robot. Raises InputError if the mission lacks it."""
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


def make_driver(path: Path, robot: str, options: RobotOptions) -> Driver:
    """Assemble a robot. Raises InputError."""
    mission = load_mission(path)
    reference = options.program or mission.program
    if reference is None:
        raise InputError(f"mission {mission.name} names no program: give one with --program")
    return Driver(robot_setup(mission, robot, options, load_program(reference), reference))


def robot_setup(
    mission: Mission,
    robot: str,
    options: RobotOptions,
    program: RobotProgram,
    reference: str,
    guest_log: Any = None,
) -> RobotSetup:
    """Return the parts of a robot; `reference` names the program in messages. Raises InputError.

    `guest_log`: where it logs if it is a guest in another program.
    """
    kind, capabilities = robot_of(mission, robot, options.type)
    solver = solver_for(mission, options.solver)
    require_threads()
    logger = guest_log or robot_logger(robot)
    require_program(program, reference, mission, {robot: capabilities})
    functions_of(program).check_computer()
    expected = _expected(options, mission)
    address = on_network(mission, options, robot)
    if address.transport.misses_ipv6():
        logger.warning("no_ipv6", listens=address.transport.where())
    keys, manifest = keys_of(address.keys, robot)
    if keys is None:
        logger.warning("not_secure", reason="messages are not signed")
    journal = open_journal(options.run_dir, mission, address.run, robot, logger)
    restored, problem = _begin(journal, mission)
    meter, engine = None, chosen_engine()
    if options.metrics_port is not None:
        metrics_address = plugins.MetricsAddress(options.metrics_port, options.metrics_host)
        meter = plugins.metrics().meter(robot, mission, metrics_address)
        engine = meter.timed(engine)
    is_large = len(mission.robots) >= LARGE_ROBOTS or len(mission.tree.nodes) >= LARGE_NODES
    config = AgentConfig(
        robot=robot,
        type=kind,
        capabilities=dict(capabilities),
        run=address.run,
        nonce=secrets.token_hex(4),
        solver=solver,
        lacks_planner=lacks_planner(),
        plans_apart=is_large,
        engine=engine,
        timing=address.timing,
        expected=expected,
        gather_us=round(options.gather_s * SECOND_US),
        alone_after_us=round(options.alone_after_s * SECOND_US),
        listens=address.transport.where(),
        takeover=options.takeover,
        exit_when_done=options.exit_when_done,
        software=__version__,
        host=socket.gethostname(),
        pid=os.getpid(),
        restored=restored,
        keeps_journal=journal is not None,
        journal_problem=problem,
        recording_problem="" if options.record is not None else NOT_ASKED,
        keys=keys,
        life=time.time_ns() // 1_000,
    )
    return RobotSetup(
        mission,
        config,
        options,
        address.transport,
        program,
        journal,
        manifest,
        meter,
        guest_log,
        is_guest=guest_log is not None,
    )


def _begin(journal: Journal | None, mission: Mission) -> tuple[tuple[Entry, ...], str]:
    """Return what the journal holds, and why it cannot be written (empty if it can)."""
    if journal is not None:
        entries, reason = journal.begin()
        return entries, f"journal cannot be written: {reason}" if reason else ""
    if mission.has_tasks_at_most_once:
        return (), NO_JOURNAL
    return (), ""


def _expected(options: RobotOptions, mission: Mission) -> frozenset[str]:
    """Return the robots that it waits for. Raises InputError."""
    if options.alone:
        return frozenset()
    expected = list(mission.robots) if options.expect is None else options.expect
    for robot in expected:
        if not is_robot_id(robot):
            raise InputError(f"--expect {','.join(expected)}: {robot!r} is not a robot's id")
    return frozenset(expected)


def open_journal(
    run_dir: Path | None, mission: Mission, run: str, robot: str, logger: Any
) -> Journal | None:
    """Return the robot's journal in its run directory, not yet opened; None without a directory."""
    if run_dir is None:
        return None

    def log(level: str, event: str, **fields: Any) -> None:
        getattr(logger, level)(event, **fields)

    return Journal(journal_path(run_dir, robot), mission.team_digest, run, robot, log)


def claim_run_dir(run_dir: Path, robot: str, takeover: bool) -> str:
    """Make this process the robot of the run directory. Raises InputError if another one runs.

    Returns why this could not be recorded there; empty if it was. A robot with its own directory
    continues in that case. In the directory of a run, no command would find it, and it would
    outlive its team, so InputError is raised.
    """
    run_dir.mkdir(mode=0o700, parents=True, exist_ok=True)
    found = RunDir(run_dir)
    running = found.process(robot)
    # In a restarted container, the last life may have had this very pid.
    if running is not None and running.pid != os.getpid() and not takeover:
        raise InputError(
            f"robot {robot} is already running here (pid {running.pid}): stop it first, "
            "or start with --takeover to replace it"
        )
    try:
        found.write_process(robot)
    except OSError as error:
        why = error.strerror or str(error)
        if found.has_run:
            raise InputError(
                f"robot {robot} does not start: {run_dir / robot}.process cannot be written: "
                f"{why}; make room on its disk, or have it mounted for writing"
            ) from error
        return why
    return ""


def run_robot(mission: Path, robot: str, options: RobotOptions) -> NoReturn:
    """Run one robot; ends the process itself, since a Zenoh session may take 10 s to close."""
    message = problem = ""
    output = RunDir(options.run_dir).output_path(robot) if options.run_dir else None
    protect_output(output if output is not None and output.exists() else None, options.keep_bytes)
    try:
        # Before anything that may take long or never end, such as importing a program.
        launcher = LauncherWatch(options.while_locked) if options.while_locked is not None else None
        if options.run_dir is not None:
            problem = claim_run_dir(options.run_dir, robot, options.takeover)
        configure_log(robot, options.run_dir, options.keep_bytes)
        if problem:
            robot_logger(robot).error("process_not_written", reason=problem)
        driver = make_driver(mission, robot, options)
        # Permanent objects are excluded from garbage collection: with a large mission, each
        # collection would take longer than a robot should be deaf.
        gc.collect()
        gc.freeze()
        stop = driver.run(launcher)
        code = stop.code
        if code == 2 or options.run_dir is None:
            message = f"{robot}: {stop.reason}"
    except BrokenRobotError as error:
        code, message = BROKEN, f"{robot} {error}"
    except (InputError, OSError, ValueError) as error:
        code, message = 2, str(error)
    if message:
        sys.stderr.write(f"mrbt agent: {message}\n")
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)
