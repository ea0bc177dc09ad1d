"""`mrbt sim --chaos` and `--schedule`: many random runs, and what to do about those that fail."""

from __future__ import annotations

import json
import shutil
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import count, takewhile
from pathlib import Path
from typing import Any

import typer
from rich.markup import escape
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from mrbt_mesh.cli.common import (
    FAILURE,
    NOT_FINISHED,
    SUCCESS,
    InputError,
    bar_of_runs,
    checked_program,
    console,
    errors,
    fail,
    print_json,
    read_mission,
)
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim.chaos.campaign import CRASH, Source, Verdict, campaign, judge
from mrbt_mesh.sim.chaos.generate import PROGRAM_FILE, generate_mission
from mrbt_mesh.sim.chaos.minimise import Minimised, minimise
from mrbt_mesh.sim.engine.injector import fault_text
from mrbt_mesh.sim.engine.scenario import Scenario, ScenarioError, dump, scenario_from_json

MAX_MINIMISED = 3
MAX_SHOWN = 20
INVARIANTS = {
    "I1": "same facts, same plan",
    "I2": "facts converge, nobody is dead who is heard",
    "I3": "nothing done is undone",
    "I4": "nobody beyond its means, bounds hold",
    "I5": "an exclusive task has one coalition",
    "I6": "what can be finished is finished",
    "I7": "assignments optimal and canonical",
    "I8": "garbage changes nothing",
    "I9": "restarts resume from the journal",
    CRASH: "nothing breaks",
}


def parse_seeds(text: str) -> list[int]:
    """`0:1000` (the last one left out), `7`, or `3,9,12`; raises InputError."""
    try:
        if ":" in text:
            first, last = (int(part) for part in text.split(":"))
            seeds = list(range(first, last))
        else:
            seeds = [int(part) for part in text.split(",")]
    except ValueError:
        seeds = []
    if not seeds or seeds[0] < 0:
        raise InputError(f"--seeds {text}: expected FIRST:END, e.g. 0:1000, or seeds, e.g. 3,9")
    return seeds


@dataclass(frozen=True)
class Options:
    """How a campaign is run; `mission` is the file as given, None for generated ones.

    With `minutes` it goes on with the seeds that follow until so much time has passed.
    """

    mission: Path | None
    source: Source
    seeds: Sequence[int]
    jobs: int
    keep: Path
    budget_s: float
    as_json: bool
    minutes: float | None = None

    def all_seeds(self) -> Iterator[int]:
        """The seeds to run, in order."""
        if self.minutes is None:
            yield from self.seeds
            return
        until_s = time.monotonic() + 60 * self.minutes
        yield from takewhile(lambda _: time.monotonic() < until_s, count(self.seeds[0]))


def make_source(mission: Path | None, program: str | None, speed: float) -> Source:
    """The source of a campaign's missions; raises InputError and what reading them raises."""
    if mission is None:
        return Source(speed=speed)
    model = read_mission(mission)
    return Source(str(mission), checked_program(model, sorted(model.robots), program), speed)


def run_chaos(options: Options) -> None:
    """Run all seeds; ends with exit status 1 if an invariant broke."""
    started_s = time.monotonic()
    verdicts, interrupted = _run_all(options)
    took_s = time.monotonic() - started_s
    failed = sorted((v for v in verdicts if v.violations), key=lambda verdict: verdict.seed)
    reports = [_report(options, v, n < MAX_MINIMISED) for n, v in enumerate(failed[:MAX_SHOWN])]
    totals = _totals(verdicts, took_s)
    if options.as_json:
        print_json({**totals, "interrupted": interrupted, "failures": reports})
    else:
        _show(totals, reports, len(failed))
    if interrupted:
        fail("interrupted", NOT_FINISHED)
    raise typer.Exit(FAILURE if failed else SUCCESS)


def _run_all(options: Options) -> tuple[list[Verdict], bool]:
    verdicts: list[Verdict] = []
    failures = 0
    total = len(options.seeds) if options.minutes is None else None
    with bar_of_runs("{task.fields[rate]:.1f} seeds/s", "{task.fields[failures]}") as bar:
        task = bar.add_task("chaos", total=total, rate=0.0, failures="")
        started_s = time.monotonic()
        runs = campaign(options.source, options.all_seeds(), options.jobs)
        try:
            for verdict in runs:
                verdicts.append(verdict)
                failures += bool(verdict.violations)
                rate = len(verdicts) / max(0.001, time.monotonic() - started_s)
                text = f"[red]{failures} failed[/]" if failures else "[green]none failed[/]"
                bar.update(task, advance=1, rate=rate, failures=text)
        except KeyboardInterrupt:
            return verdicts, True
        finally:
            runs.close()  # type: ignore[attr-defined]
    return verdicts, False


def _totals(verdicts: Sequence[Verdict], took_s: float) -> dict[str, Any]:
    checks: Counter[str] = Counter()
    seeds: Counter[str] = Counter()
    for verdict in verdicts:
        checks.update(verdict.checks)
        seeds.update(verdict.checks.keys())
    return {
        "seeds": len(verdicts),
        "took_s": round(took_s, 3),
        "results": dict(Counter(v.result for v in verdicts)),
        "checks": {name: checks[name] for name in sorted(checks)},
        "seeds_checked": {name: seeds[name] for name in sorted(checks)},
        "done_twice": sum(v.done_twice for v in verdicts),
        "exclusive_done_twice": sum(v.exclusive_done_twice for v in verdicts),
    }


# -- what failed ------------------------------------------------------------------------------


def _report(options: Options, verdict: Verdict, minimised: bool) -> dict[str, Any]:
    """What there is to say about a failing seed; writes its schedule, cut down if there is time."""
    seed, source = verdict.seed, options.source
    name = f"--generated --seeds {seed}"
    if options.mission is not None:
        name = f"{options.mission} --seeds {seed}"
    if source.speed != 1.0:
        name += f" --speed {source.speed:g}"
    report = {
        "seed": seed,
        "violations": list(verdict.violations),
        "command": f"mrbt sim --chaos {name}",
    }
    mission, program = source.load(seed)
    scenario = source.scenario(seed, mission)
    try:
        options.keep.mkdir(parents=True, exist_ok=True)
        where = _keep_mission(options, seed)
        path = options.keep / f"seed-{seed}.json"
        path.write_text(dump(scenario, **where), encoding="utf-8")
        report |= {"schedule": str(path), "replay": f"mrbt sim --schedule {path}"}
        if minimised and options.budget_s > 0:
            found = _minimise(mission, program, scenario, verdict, options.budget_s)
            path = options.keep / f"seed-{seed}-minimised.json"
            path.write_text(dump(found.scenario, **where), encoding="utf-8")
            report |= {
                "minimised": [[at_us / 1e6, fault_text(f)] for at_us, f in found.scenario.steps],
                "of": len(scenario.steps),
                "runs": found.runs,
                "is_minimal": found.is_done,
                "schedule": str(path),
                "replay": f"mrbt sim --schedule {path}",
            }
    except OSError as error:
        fail(f"{error.filename}: cannot be written: {error.strerror}")
    return report


def _keep_mission(options: Options, seed: int) -> dict[str, Any]:
    """Where a schedule finds its mission: a generated one is written next to it."""
    if options.mission is not None:
        return {"mission": str(options.mission.resolve()), "program": options.source.program}
    path = options.keep / f"seed-{seed}.yaml"
    path.write_text(generate_mission(seed).text, encoding="utf-8")
    shutil.copy(PROGRAM_FILE, options.keep / PROGRAM_FILE.name)
    return {"mission": path.name, "program": None}


def _minimise(
    mission: Mission, program: RobotProgram, scenario: Scenario, verdict: Verdict, budget_s: float
) -> Minimised:
    def fails(smaller: Scenario) -> bool:
        return bool(judge(mission, program, smaller).invariants & verdict.invariants)

    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=errors, transient=True) as bar:
        task = bar.add_task(f"cutting down seed {verdict.seed}")

        def progress(runs: int, steps: int) -> None:
            text = f"cutting down seed {verdict.seed}: {steps} faults left after {runs} runs"
            bar.update(task, description=text)

        return minimise(scenario, fails, budget_s, progress)


def _show(totals: dict[str, Any], reports: Iterable[dict[str, Any]], failed: int) -> None:
    results = ", ".join(f"{number} {name}" for name, number in sorted(totals["results"].items()))
    rate = totals["seeds"] / max(0.001, totals["took_s"])
    line = f"{totals['seeds']} seeds in {totals['took_s']:.1f} s, {rate:.1f} a second: {results}"
    mark = f"[bold red]✘ {failed} failed[/]" if failed else "[bold green]✔ no invariant broken[/]"
    console.print(f"{mark}  {line}", highlight=False)
    table = Table(box=None, padding=(0, 2, 0, 0))
    for title, justify in (("", "left"), ("", "left"), ("checks", "right"), ("in seeds", "right")):
        table.add_column(title, justify=justify)  # type: ignore[arg-type]
    for name, checked in totals["checks"].items():
        seeds = totals["seeds_checked"][name]
        table.add_row(name, INVARIANTS.get(name, ""), f"{checked:,}", f"{seeds:,}")
    console.print(table)
    text = (
        f"done more often than their max, in partitions and after crashes: {totals['done_twice']} "
        f"local tasks, {totals['exclusive_done_twice']} of exclusive ones"
    )
    console.print(f"[dim]{text}[/]", highlight=False, soft_wrap=True)
    for report in reports:
        _show_failure(report)


def _show_failure(report: dict[str, Any]) -> None:
    console.print(f"\n[bold red]seed {report['seed']}[/]", highlight=False)
    for violation in report["violations"][:3]:
        name = violation.partition(" ")[0]
        rule = f" [dim]({INVARIANTS.get(name, name)})[/]"
        console.print(f"  {escape(violation)}{rule}", highlight=False, soft_wrap=True)
    if "minimised" in report:
        word = "" if report["is_minimal"] else ", time was up"
        text = f"of {report['of']} faults these {len(report['minimised'])} are enough"
        console.print(f"  [bold]{text}[/] ({report['runs']} runs{word}):", highlight=False)
        for at_s, fault in report["minimised"]:
            console.print(f"  {at_s:12.6f} s  {escape(fault)}", highlight=False, soft_wrap=True)
    for key in ("replay", "command"):
        if key in report:
            console.print(f"  {key}: {report[key]}", highlight=False, soft_wrap=True)


# -- replaying --------------------------------------------------------------------------------


def read_schedule(
    path: Path, mission: Path | None, program: str | None
) -> tuple[Mission, RobotProgram, Scenario]:
    """A schedule file with its mission, which `mission` overrides.

    Raises InputError for whatever is wrong with the file.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(data, dict):
            raise ScenarioError("an object with mission, seed, robots, steps is expected")
        named, own = data.pop("mission", None), data.pop("program", None)
        scenario = scenario_from_json(data)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:  # also what JSON and UTF-8 raise
        raise InputError(f"{path}: {error}") from None
    if mission is None and not isinstance(named, str):
        raise InputError(f"{path}: names no mission; give one as the argument MISSION")
    model = read_mission(mission or path.parent / str(named))
    unknown = sorted(set(scenario.robots) - model.robots.keys())
    if unknown:
        raise InputError(f"{path}: mission {model.name} has no robot {', '.join(unknown)}")
    reference = program or (own if mission is None and isinstance(own, str) else None)
    code = load_program(checked_program(model, sorted(model.robots), reference))
    return model, code, scenario
