"""The end of a run without living processes: its summary and its status.

    python -m mrbt_mesh.cli.finished RUN_DIR

waits until a detached team has ended, and writes its summary. While it waits it uses few resources.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.run_dir import RunDir


def summary_of_finished(run_dir: RunDir, *, is_witness: bool = False) -> dict[str, Any] | None:
    """Return the summary of a run without living processes, else None.

    The summary is written first if the team was detached or its launcher killed. `is_witness`: this
    process has seen the run end, so its signature closes the recordings; that of another one says
    that it was made afterwards. Raises InputError, with nothing written, for a damaged run
    directory and for a key that cannot be used.
    """
    from mrbt_mesh.runtime.known_runs import is_running

    if is_running(run_dir):
        return None
    summary = run_dir.summary()
    if not run_dir.robots() or (summary is not None and not is_witness):
        return summary
    # Loads Zenoh, which who only reads a summary need not wait for.
    from mrbt_mesh.runtime.summary_signature import is_closed, summary_keys

    if is_witness and is_closed(run_dir):
        return summary
    summary_keys(run_dir)  # raises if they are refused
    info = run_dir.info()
    made = _summary(run_dir)
    # The run may have been continued meanwhile: then that was not its last end.
    if run_dir.info() != info or is_running(run_dir):
        return None
    _write_summary(run_dir, made, is_witness=is_witness)
    return run_dir.summary()


def _write_summary(run_dir: RunDir, summary: dict[str, Any], *, is_witness: bool) -> None:
    """Write and sign a summary, unless there is one already.

    A witness replaces one that was not signed at the end: `mrbt status` may have been faster.
    """
    from mrbt_mesh.runtime.summary_signature import is_closed, sign_summary

    with _one_at_a_time(run_dir):
        if is_witness and not is_closed(run_dir):
            run_dir.write_summary(summary)
            sign_summary(run_dir)
        elif run_dir.write_first_summary(summary):
            sign_summary(run_dir, int(time.time()))


@contextlib.contextmanager
def _one_at_a_time(run_dir: RunDir) -> Iterator[None]:
    """Have one process at a time write and sign the summary."""
    descriptor = os.open(run_dir.path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        # Some network disks have no locks.
        with contextlib.suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def has_ended(run_dir: RunDir) -> bool:
    """True if a run has ended and can be continued.

    Raises InputError if its mission is over, so that robots would find nothing to do.
    """
    from mrbt_mesh.observer.summary import ABORTED

    summary = summary_of_finished(run_dir)
    if summary is None:
        return False
    ends = summary.get("ends") != "never" or summary.get("ended_because") == ABORTED
    if ends and summary["result"] in ("success", "failure"):
        text = f"{run_dir.path}: the mission is over ({summary['result']})"
        raise InputError(f"{text}; `mrbt up` begins one anew")
    return True


def reopen(run_dir: RunDir) -> bool:
    """Remove the end of a run that can be continued. Returns whether it had ended.

    Raises as `has_ended`.
    """
    had_ended = has_ended(run_dir)
    if had_ended:
        run_dir.remove_summary()
    return had_ended


def _summary(run_dir: RunDir) -> dict[str, Any]:
    """Return the summary of a run that has ended, from its recordings and journals."""
    from mrbt_mesh.cli.operator_end import with_operator_end
    from mrbt_mesh.core.assignment.solvers import default_solver
    from mrbt_mesh.formats.mission_file import load_mission
    from mrbt_mesh.observer.observer import Observer
    from mrbt_mesh.observer.summary import run_summary
    from mrbt_mesh.runtime.fencing import boottime_us
    from mrbt_mesh.runtime.past import tell_past
    from mrbt_mesh.runtime.solver_loader import chosen_engine
    from mrbt_mesh.runtime.team import Team
    from mrbt_mesh.runtime.team_address import timing_of

    info, mission = run_dir.info(), load_mission(run_dir.mission_path)
    timing = timing_of(info.options.beat_s, info.options.detection_s, mission)
    observer = Observer(mission, info.run, timing, default_solver, chosen_engine())
    # A run without a result ended with the last record; without recordings nobody knows when.
    recorded_us = tell_past(observer, run_dir.path, info.started_unix_s, ())
    ended_us = boottime_us() if recorded_us is None else recorded_us
    team = Team(run_dir, info, mission)
    result = team.result(observer, ended_us)
    team.note_unseen_deaths(observer, ended_us)
    summary = run_summary(observer, result, ended_us)
    if observer.record.ended_us is None and recorded_us is None:
        summary["duration_s"] = None
    if observer.record.result is None:
        summary["ended_because"] = "no robot is left"
        died = {fault.robot for fault in observer.record.major if fault.until_us is None}
        for robot, row in summary["robots"].items():
            row["state"] = "dead" if robot in died else "left"
        summary = with_operator_end(summary, observer.record, run_dir, "")
    return summary | {"run_dir": str(run_dir.path)}


def print_summary(summary: dict[str, Any], as_json: bool) -> None:
    """Print a summary as `up` does at the end of a run."""
    from mrbt_mesh.cli.terminal import console, print_json
    from mrbt_mesh.cli.views.summary_view import render_summary

    if as_json:
        print_json(summary)
    else:
        console.print(render_summary(summary))


def print_finished(summary: dict[str, Any], as_json: bool) -> None:
    """Print the summary of a finished run; as JSON with the keys of a running team's status."""
    if not as_json:
        click.echo(f"the run is over: {summary['result']}")
        print_summary(summary, as_json=False)
        return
    robots = {
        robot: {**row, "pid": None, "local_task": None} for robot, row in summary["robots"].items()
    }
    status = {**summary, "over": True, "robots": robots, "bounds": []}
    status |= {"blocked": [], "agreement": True}
    click.echo(json.dumps(status, indent=2))


def start_summary_writer(run_dir: RunDir) -> None:
    """Start the process that writes the summary of a detached team."""
    with run_dir.opened_output(run_dir.path / "summary_writer.out") as output:
        subprocess.Popen(
            [sys.executable, "-m", "mrbt_mesh.cli.finished", str(run_dir.path)],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            start_new_session=True,
        )


def wait_and_write(run_dir: RunDir) -> None:
    """Write the summary once no robot of the run is left, including robots that join later."""
    import psutil

    while running := [p for robot in run_dir.robots() if (p := run_dir.process(robot)) is not None]:
        psutil.wait_procs(running)
    summary_of_finished(run_dir, is_witness=True)


if __name__ == "__main__":
    wait_and_write(RunDir(Path(sys.argv[1])))
