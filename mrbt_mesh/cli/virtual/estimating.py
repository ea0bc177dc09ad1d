"""Many runs under a failure model, and their statistics."""

from __future__ import annotations

import time

from mrbt_mesh.cli.command import FAILURE, NOT_FINISHED, fail
from mrbt_mesh.cli.terminal import bar_of_runs, console, print_json
from mrbt_mesh.cli.views.estimate_view import render_estimate
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.sim.estimate import Experiment, RunOutcome, outcomes, summarise
from mrbt_mesh.sim.run import SimulationError


def run_and_print(experiment: Experiment, mission: Mission, jobs: int, as_json: bool) -> None:
    """Make the runs in `jobs` processes and print their statistics.

    Ends with exit status 1 if an agent or a program broke, 3 if it was interrupted.
    """
    started_s = time.monotonic()
    found, interrupted = _run(experiment, jobs)
    took_s = time.monotonic() - started_s
    if as_json:
        print_json(
            {
                "mission": mission.name,
                "runs": 0,
                "seed": experiment.seed,
                "interrupted": interrupted,
                **(summarise(found).to_json() if found else {}),
            }
        )
    elif found:
        console.print(render_estimate(mission, summarise(found), took_s, jobs))
    if interrupted:
        fail("interrupted", NOT_FINISHED)


def _run(experiment: Experiment, jobs: int) -> tuple[list[RunOutcome], bool]:
    found: list[RunOutcome] = []
    with bar_of_runs("{task.fields[rate]:.0f} runs a minute") as bar:
        task = bar.add_task("estimate", total=experiment.runs, rate=0.0)
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
