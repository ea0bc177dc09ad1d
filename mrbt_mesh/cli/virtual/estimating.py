"""Many runs under failure models, and the figures that come of them."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mrbt_mesh.cli.framework.exits import FAILURE, NOT_FINISHED, fail
from mrbt_mesh.cli.framework.progress import bar_of_runs
from mrbt_mesh.cli.framework.terminal import console, print_json
from mrbt_mesh.cli.views.estimate_view import render_estimate
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.sim.estimate import Experiment, RunOutcome, Summary, outcomes, summarise
from mrbt_mesh.sim.run import SimulationError
from mrbt_mesh.sim.statistics.plotting import plot


def estimate_and_tell(
    experiment: Experiment, mission: Mission, jobs: int, plot_file: Path | None, as_json: bool
) -> None:
    """Make the runs in so many processes, and print and draw what they say.

    Ends with exit status 1 if an agent or a program broke, 3 if it was interrupted. Raises
    PlotError for a picture that cannot be made.
    """
    started_s = time.monotonic()
    found, interrupted = _run(experiment, jobs)
    took_s = time.monotonic() - started_s
    summaries = summarise(experiment, found)
    if plot_file is not None and summaries:
        plot(summaries, f"{mission.name}, {experiment.runs} runs each", plot_file)
    if as_json:
        print_json(_as_data(experiment, mission, summaries, interrupted))
    elif summaries:
        console.print(render_estimate(mission, summaries, len(found), took_s, jobs))
    if interrupted:
        fail("interrupted", NOT_FINISHED)


def _run(experiment: Experiment, jobs: int) -> tuple[list[RunOutcome], bool]:
    found: list[RunOutcome] = []
    with bar_of_runs("{task.fields[rate]:.0f} runs a minute") as bar:
        total = experiment.runs * len(experiment.points)
        task = bar.add_task("estimate", total=total, rate=0.0)
        started_s = time.monotonic()
        made = outcomes(experiment, jobs)
        try:
            for outcome in made:
                found.append(outcome)
                rate = 60 * len(found) / max(0.001, time.monotonic() - started_s)
                bar.update(task, advance=1, rate=rate)
        except KeyboardInterrupt:
            return found, True
        except SimulationError as error:
            fail(str(error), FAILURE)
        finally:
            made.close()  # type: ignore[attr-defined]
    return found, False


def _as_data(
    experiment: Experiment, mission: Mission, summaries: Sequence[Summary], interrupted: bool
) -> dict[str, Any]:
    return {
        "mission": mission.name,
        "runs": experiment.runs,
        "seed": experiment.seed,
        "interrupted": interrupted,
        "points": [summary.to_json() for summary in summaries],
    }
