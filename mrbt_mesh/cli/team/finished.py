"""The status of a run that has ended, as its summary tells it."""

from __future__ import annotations

import json
from typing import Any

import click

from mrbt_mesh.runtime.run_dir import RunDir


def summary_of_finished(run_dir: RunDir) -> dict[str, Any] | None:
    """The summary of a run of which no process is left, else None."""
    summary = run_dir.summary()
    if summary is None or any(run_dir.process(robot) for robot in run_dir.robots()):
        return None
    return summary


def tell_finished(summary: dict[str, Any], as_json: bool) -> None:
    """Print it; as JSON with the keys of a running team's status."""
    if not as_json:
        click.echo(f"the run is over: {summary['result']}")
        return
    robots = {
        robot: {**row, "pid": None, "local_task": None} for robot, row in summary["robots"].items()
    }
    status = {**summary, "over": True, "robots": robots, "bounds": []}
    status |= {"blocked": [], "agreement": True}
    click.echo(json.dumps(status, indent=2))
