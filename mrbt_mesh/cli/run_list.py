"""The runs of this machine as rows, for `mrbt ls` and for the page that lists them."""

from __future__ import annotations

from typing import Any

from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.known_runs import is_running, known_runs, team_name
from mrbt_mesh.runtime.run_dir import RunDir

RUNNING, DAMAGED = "running", "damaged"


def listed_runs() -> list[dict[str, Any]]:
    """Return a row of plain data for each run: running ones first, then the newest."""
    return sorted(map(_row, known_runs()), key=lambda row: row["result"] != RUNNING)


def _row(run_dir: RunDir) -> dict[str, Any]:
    from mrbt_mesh.cli.finished import summary_of_finished

    row: dict[str, Any] = {"team": team_name(run_dir), "mission": None, "run": None}
    row |= {"run_dir": str(run_dir.path), "started_unix_s": None, "robots": 0, "alive": 0}
    try:
        info = run_dir.info()
        row |= {"mission": info.mission_name, "run": info.run}
        row |= {"started_unix_s": info.started_unix_s, "robots": len(run_dir.members())}
        if is_running(run_dir):
            return row | {"alive": len(run_dir.living()), "result": RUNNING}
        summary = summary_of_finished(run_dir) or {"result": "not_started"}
        return row | {"result": summary["result"]}
    except InputError:
        return row | {"result": DAMAGED}
