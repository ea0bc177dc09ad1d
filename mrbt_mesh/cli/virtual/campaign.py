"""Many random runs, one for each seed; failed ones are minimised and kept."""

from __future__ import annotations

import shlex
import shutil
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count, takewhile
from pathlib import Path
from typing import Any, NoReturn

from mrbt_mesh.cli.command import FAILURE, NOT_FINISHED, SUCCESS, fail
from mrbt_mesh.cli.terminal import bar_of_steps, console, print_json, reason, with_bar
from mrbt_mesh.cli.views.chaos_view import render_campaign
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.sim.chaos.campaign import Source, Verdict, campaign, judge
from mrbt_mesh.sim.chaos.generate import PROGRAM_FILE, generate_mission
from mrbt_mesh.sim.chaos.minimise import Minimised, minimise
from mrbt_mesh.sim.world.faults import fault_text
from mrbt_mesh.sim.world.scenario import Scenario, dump

MAX_MINIMISED = 3
MAX_SHOWN = 20


@dataclass(frozen=True)
class Campaign:
    """The seeds and missions to run.

    `keep` is the folder for failed runs; `budget_s` is the time to minimise one. With `minutes` the
    campaign continues for that long with the seeds that follow the first.
    """

    source: Source
    seeds: Sequence[int]
    jobs: int
    keep: Path
    budget_s: float
    minutes: float | None

    def all_seeds(self) -> Iterator[int]:
        """Yield the seeds to run, in order."""
        if self.minutes is None:
            yield from self.seeds
            return
        until_s = time.monotonic() + 60 * self.minutes
        yield from takewhile(lambda _: time.monotonic() < until_s, count(self.seeds[0]))


def run_campaign(plan: Campaign, as_json: bool) -> NoReturn:
    """Run all seeds, print the results, and end with exit status 1 if an invariant broke."""
    started_s = time.monotonic()
    runs = campaign(plan.source, plan.all_seeds(), plan.jobs)
    total = len(plan.seeds) if plan.minutes is None else None
    verdicts, interrupted = with_bar("chaos", runs, total, lambda verdict: bool(verdict.violations))
    took_s = time.monotonic() - started_s
    failed = sorted((v for v in verdicts if v.violations), key=lambda verdict: verdict.seed)
    reports = [_report(plan, v, n < MAX_MINIMISED) for n, v in enumerate(failed[:MAX_SHOWN])]
    totals = _totals(verdicts, took_s)
    if as_json:
        print_json({**totals, "interrupted": interrupted, "failures": reports})
    elif verdicts:
        console.print(render_campaign(totals, reports, len(failed)), soft_wrap=True)
    if interrupted:
        fail("interrupted", NOT_FINISHED)
    raise SystemExit(FAILURE if failed else SUCCESS)


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


# -- failed runs ------------------------------------------------------------------------------


def _report(plan: Campaign, verdict: Verdict, minimised: bool) -> dict[str, Any]:
    """Report a failed seed, and write its schedule, minimised if there is time.

    Raises InputError if the files cannot be written.
    """
    seed, source = verdict.seed, plan.source
    mission, program = source.load(seed)
    scenario = source.scenario(seed, mission)
    report: dict[str, Any] = {
        "seed": seed,
        "violations": list(verdict.violations),
        "command": _command(source, seed, mission),
    }
    try:
        plan.keep.mkdir(parents=True, exist_ok=True)
        where = _keep_mission(plan, seed)
        report |= _keep_schedule(plan.keep / f"seed-{seed}.json", scenario, where)
        if minimised and plan.budget_s > 0:
            found = _minimise(mission, program, scenario, verdict, plan.budget_s)
            smaller = plan.keep / f"seed-{seed}-minimised.json"
            report |= _keep_schedule(smaller, found.scenario, where)
            report |= {
                "minimised": [[at_us / 1e6, fault_text(f)] for at_us, f in found.scenario.steps],
                "of": len(scenario.steps),
                "runs": found.runs,
                "is_minimal": found.is_done,
            }
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be written: {reason(error)}") from None
    return report


def _command(source: Source, seed: int, mission: Mission) -> str:
    """Return the command that runs this seed again."""
    words = ["mrbt", "sim", "chaos", source.mission or "--generated", "--seeds", str(seed)]
    if source.program is not None and source.program != mission.program:
        words += ["--program", source.program]
    if source.speed != 1.0:
        words += ["--speed", f"{source.speed:g}"]
    return shlex.join(words)


def _keep_mission(plan: Campaign, seed: int) -> dict[str, Any]:
    """Return where a schedule finds its mission; a generated mission is written next to it."""
    if plan.source.mission is not None:
        mission = str(Path(plan.source.mission).resolve())
        return {"mission": mission, "program": plan.source.program}
    path = plan.keep / f"seed-{seed}.yaml"
    path.write_text(generate_mission(seed).text, encoding="utf-8")
    shutil.copy(PROGRAM_FILE, plan.keep / PROGRAM_FILE.name)
    return {"mission": path.name, "program": None}


def _keep_schedule(path: Path, scenario: Scenario, where: dict[str, Any]) -> dict[str, Any]:
    path.write_text(dump(scenario, **where), encoding="utf-8")
    replay = shlex.join(["mrbt", "sim", "run", "--schedule", str(path)])
    return {"schedule": str(path), "replay": replay}


def _minimise(
    mission: Mission, program: RobotProgram, scenario: Scenario, verdict: Verdict, budget_s: float
) -> Minimised:
    def fails(smaller: Scenario) -> bool:
        return bool(judge(mission, program, smaller).invariants & verdict.invariants)

    text = f"cutting down seed {verdict.seed}"
    with bar_of_steps(text) as update:

        def progress(runs: int, steps: int) -> None:
            update(f"{text}: {steps} faults left after {runs} runs", 0, None)

        return minimise(scenario, fails, budget_s, progress)
