"""`mrbt simulate`: many runs under failure models; success, durations, and curves of both."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from mrbt_mesh.cli.common import (
    FAILURE,
    NOT_FINISHED,
    InputError,
    JsonOption,
    MissionArgument,
    bar_of_runs,
    checked_program,
    console,
    fail,
    input_errors,
    print_json,
    read_mission,
)
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.sim.engine.failures import FailureModel
from mrbt_mesh.sim.run import SimulationError
from mrbt_mesh.sim.statistics.estimate import (
    PERCENTILES,
    Experiment,
    Outcome,
    Summary,
    outcomes,
    summarise,
)
from mrbt_mesh.sim.statistics.plotting import PlotError, plot
from mrbt_mesh.sim.statistics.sweeps import (
    FAILURE_RATE,
    FAULT_RATE,
    MINOR_RATE,
    SweepError,
    parse_chances,
    parse_rates,
    points_of,
)
from mrbt_mesh.sim.statistics.team_sizes import describe, resized

MANY = list[str] | None

_FAULTS = "What befalls the team"
_RUNS = "The runs"


def _option(text: str, panel: str, metavar: str | None = None, **more: Any) -> Any:
    return typer.Option(help=text, metavar=metavar, rich_help_panel=panel, **more)


def simulate(
    mission: MissionArgument,
    runs: Annotated[int, _option("Runs of each setting.", _RUNS, min=1)] = 1_000,
    fault_rate: Annotated[
        MANY,
        _option(
            "Robots die: a chance per completed action, or a number per hour.",
            _FAULTS,
            "[WHO:]P[/action|/hour]",
        ),
    ] = None,
    minor_rate: Annotated[
        MANY, _option("Robots lose a capability, likewise.", _FAULTS, "[WHO:]P[/action|/hour]")
    ] = None,
    failure_rate: Annotated[
        MANY, _option("Actions fail with this chance.", _FAULTS, "[LOCAL_TASK:]P")
    ] = None,
    major: Annotated[int, _option("So many robots die, at random times.", _FAULTS, min=0)] = 0,
    minor: Annotated[
        int, _option("So many capabilities are lost, at random times.", _FAULTS, min=0)
    ] = 0,
    within: Annotated[
        float | None,
        _option(
            "The time for --major and --minor. Default: as long as an undisturbed mission takes.",
            _FAULTS,
            "SECONDS",
        ),
    ] = None,
    return_after: Annotated[
        float | None, _option("Dead robots are started again.", _FAULTS, "SECONDS")
    ] = None,
    repair_after: Annotated[
        float | None, _option("Lost capabilities come back.", _FAULTS, "SECONDS")
    ] = None,
    robots: Annotated[
        int | None, _option("A team of another size than the file's.", _RUNS, min=1)
    ] = None,
    sweep: Annotated[
        MANY,
        _option(
            "Vary fault-rate, minor-rate, failure-rate, major, minor or robots; a second one "
            "gives a curve for each of its values.",
            _RUNS,
            "NAME=V,V,...|FIRST:LAST[:STEP]",
        ),
    ] = None,
    seed: Annotated[int, _option("The same seed, the same figures.", _RUNS, min=0)] = 0,
    jobs: Annotated[
        int | None, _option("In so many processes. Default: all cores.", _RUNS, min=1)
    ] = None,
    timeout: Annotated[float, _option("Virtual seconds until a run is given up.", _RUNS)] = 600.0,
    speed: Annotated[float, _option("Robots work this many times faster.", _RUNS)] = 1.0,
    program: Annotated[
        str | None, _option("Default: the mission's program.", _RUNS, "FILE[:NAME]")
    ] = None,
    plot_file: Annotated[
        Path | None,
        typer.Option("--plot", metavar="FILE.png", help="Draw curves, or a histogram."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Tell how likely a mission succeeds and how long it takes when robots fail by chance.

    Makes many runs of the same agents in virtual time. (`mrbt sim` makes one run, with faults
    that you name, and checks what must always hold.) A run that can never go on is ended early,
    as blocked. The same options and seed print the same figures, whatever --jobs.

    WHO is a robot or a robot type; without it, everybody. A team of another size (--robots)
    repeats the file's robots in turn, or unites them: see docs/simulate.md.

    Exit status: 0 the runs were made, 1 an agent or a program broke, 2 bad input.

    Example: mrbt simulate examples/vehicle_repair/mission.yaml --fault-rate 0.05/action

    Example: mrbt simulate examples/vehicle_repair/mission.yaml --sweep major=0:4
    --sweep robots=1,2,4,6,12 --runs 200 --plot out.png

    Example: mrbt simulate MISSION --fault-rate A:2/hour --minor-rate 0.1 --repair-after 30
    """
    model = read_mission(mission)
    with input_errors():
        reference = checked_program(model, sorted(model.robots), program)
        for name, number in (("timeout", timeout), ("speed", speed)):
            if not 0 < number < 1e9:
                raise InputError(f"--{name} {number:g}: a number above 0")
        try:
            failures = FailureModel(
                major=parse_rates(FAULT_RATE, fault_rate or (), model),
                minor=parse_rates(MINOR_RATE, minor_rate or (), model),
                actions=parse_chances(FAILURE_RATE, failure_rate or (), model),
                major_faults=major,
                minor_faults=minor,
                within_us=_microseconds("within", within) or 0,
                return_us=_microseconds("return-after", return_after),
                repair_us=_microseconds("repair-after", repair_after),
            )
            points = points_of(model, failures, robots, sweep or ())
        except ValueError as error:
            raise InputError(str(error)) from None
        if plot_file is not None and not plot_file.parent.is_dir():
            raise InputError(f"--plot {plot_file}: there is no folder {plot_file.parent}")
    experiment = Experiment(
        str(mission), reference, points, runs, seed, speed, round(timeout * 1e6)
    )
    _make_and_tell(experiment, model, jobs or os.cpu_count() or 1, plot_file, as_json)


def _make_and_tell(
    experiment: Experiment, model: Mission, jobs: int, plot_file: Path | None, as_json: bool
) -> None:
    started_s = time.monotonic()
    found, interrupted = _run(experiment, jobs)
    took_s = time.monotonic() - started_s
    summaries = summarise(experiment, found)
    if plot_file is not None and summaries:
        try:
            plot(summaries, f"{model.name}, {experiment.runs} runs each", plot_file)
        except PlotError as error:
            fail(str(error))
    if as_json:
        print_json(_json(experiment, model, summaries, interrupted))
    elif summaries:
        _show(model, summaries, len(found), took_s, jobs)
    if interrupted:
        fail("interrupted", NOT_FINISHED)


def _microseconds(name: str, seconds: float | None) -> int | None:
    if seconds is None:
        return None
    if not 0 < seconds < 1e9:
        raise SweepError(f"--{name} {seconds:g}: a number of seconds above 0")
    return round(seconds * 1e6)


def _run(experiment: Experiment, jobs: int) -> tuple[list[Outcome], bool]:
    found: list[Outcome] = []
    with bar_of_runs("{task.fields[rate]:.0f} runs a minute") as bar:
        total = experiment.runs * len(experiment.points)
        task = bar.add_task("simulate", total=total, rate=0.0)
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


def _json(
    experiment: Experiment, model: Mission, summaries: Sequence[Summary], interrupted: bool
) -> dict[str, Any]:
    return {
        "mission": model.name,
        "runs": experiment.runs,
        "seed": experiment.seed,
        "interrupted": interrupted,
        "points": [summary.to_json() for summary in summaries],
    }


# -- for people -------------------------------------------------------------------------------


def _show(
    model: Mission, summaries: Sequence[Summary], runs: int, took_s: float, jobs: int
) -> None:
    where = f"{jobs} processes" if jobs > 1 else "one process"
    text = f"{runs} runs in {took_s:.1f} s in {where}, {60 * runs / took_s:.0f} a minute"
    team = describe(model.robots)
    size = summaries[0].point.robots
    if size is not None and "robots" not in dict(summaries[0].point.values):
        team = describe(resized(model, size).robots)
    console.print(f"[bold]{model.name}[/]  {team}  [dim]{text}[/]", highlight=False)
    if summaries[0].point.values:
        console.print(_curve_table(summaries))
    else:
        _show_one(summaries[0])


def _curve_table(summaries: Sequence[Summary]) -> Table:
    table = Table(box=None, padding=(0, 1, 0, 0), header_style="dim")
    names = [name for name, _ in summaries[0].point.values]
    for name in (*names, "success", "", "95 % interval", "mean s", "p5", "median", "p95"):
        table.add_column(name, justify="left" if name == "" else "right", no_wrap=True)
    series = None
    for summary in summaries:
        values = dict(summary.point.values)
        low, high = summary.interval
        if series not in (None, summary.point.values[1:]):
            table.add_row()
        series = summary.point.values[1:]
        table.add_row(
            *(values[name] for name in names),
            f"{summary.probability:.1%}",
            f"[cyan]{_bar(summary.probability, 10):10}[/]",
            f"{low * 100:.1f} to {high * 100:.1f}",
            _seconds(summary.mean_s),
            *(_seconds(summary.percentile_s(percent)) for percent in (5, 50, 95)),
        )
    return table


def _show_one(summary: Summary) -> None:
    low, high = summary.interval
    results = ", ".join(f"{count} {name}" for name, count in summary.results.items())
    table = Table(box=None, padding=(0, 2, 0, 0), show_header=False)
    table.add_column(style="dim")
    table.add_column()
    share = f"[bold]{summary.probability:.1%}[/]  ({low:.1%} to {high:.1%} with 95 % confidence)"
    table.add_row("success", share)
    table.add_row("results", results)
    faults = f"{summary.major_faults:.2f} major and {summary.minor_faults:.2f} minor faults a run"
    table.add_row("faults", faults)
    if summary.durations_s:
        parts = [f"p{p} {_seconds(summary.percentile_s(p))}" for p in PERCENTILES]
        figures = ", ".join(parts)
        table.add_row("duration", f"[bold]{_seconds(summary.mean_s)} s[/] mean; {figures}")
    console.print(table)
    _show_histogram(summary)
    if len(summary.by_faults) > 1:
        _show_by_faults(summary)


def _show_histogram(summary: Summary) -> None:
    edges, counts = summary.histogram(12)
    if not counts or edges[-1] - edges[0] < 1e-3:
        return
    most = max(counts)
    console.print("\n[dim]duration of successful runs, s[/]")
    for number, count in enumerate(counts):
        span = f"{edges[number]:8.2f} to {edges[number + 1]:<8.2f}"
        console.print(f"{span} [cyan]{_bar(count / most, 40)}[/] {count}", highlight=False)


def _show_by_faults(summary: Summary) -> None:
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim", title_justify="left")
    for name in ("major", "minor", "runs", "success", "mean s"):
        table.add_column(name, justify="right")
    for (major, minor), (runs, successes, mean_s) in summary.by_faults.items():
        mean = _seconds(mean_s) if successes else "-"
        table.add_row(str(major), str(minor), str(runs), f"{successes / runs:.1%}", mean)
    console.print("\n[dim]by the faults that befell a run[/]")
    console.print(table)


def _bar(share: float, width: int) -> str:
    eighths = round(share * width * 8)
    full, rest = divmod(eighths, 8)
    return "█" * full + (" ▏▎▍▌▋▊▉"[rest] if rest else "")


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
