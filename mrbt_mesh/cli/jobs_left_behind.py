"""The jobs of a run that has ended, as its robots' journals hold them."""

from __future__ import annotations

from mrbt_mesh.cli.terminal import warn
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.observer.job_rows import HELD, RUNNING, WAITING, JobRow, JobRows, left_behind
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.run_dir import RunDir
from mrbt_mesh.runtime.solver_loader import chosen_engine
from mrbt_mesh.runtime.team import Team
from mrbt_mesh.runtime.team_address import timing_of

OPEN = (WAITING, HELD, RUNNING)
MOST_NAMED = 5


def jobs_left_behind(run_dir: RunDir, mission: Mission) -> list[JobRow]:
    """Return all jobs that are still known, in the order of `mrbt jobs`.

    Warns of journals that cannot be used. Raises InputError for a damaged run directory.
    """
    info = run_dir.info()
    timing = timing_of(info.options.beat_s, info.options.detection_s, mission)
    observer = Observer(mission, info.run, timing, default_solver, chosen_engine())
    journals = Team(run_dir, info, mission).journals(warn)
    observer.read((entry for kept in journals.values() for entry in kept), boottime_us())
    rows = JobRows().of(observer) if observer.facts.jobs is not None else []
    return [left_behind(row) for row in rows]


def open_jobs_text(rows: list[JobRow]) -> str:
    """Return `3 jobs go on: morning-1, ...` for people; empty if no job is open."""
    named = [row.id for row in rows if row.state in OPEN]
    if not named:
        return ""
    more = f" and {len(named) - MOST_NAMED} more" if len(named) > MOST_NAMED else ""
    count = "1 job goes on" if len(named) == 1 else f"{len(named)} jobs go on"
    cancel = "`mrbt job cancel ID` takes one back"
    return f"{count}: {', '.join(named[:MOST_NAMED])}{more} ({cancel})"
