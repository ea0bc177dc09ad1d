"""The gate: every suite at the gate's size, those that wait beside those that compute.

    python -m tests.support.gate              # all suites
    python -m tests.support.gate browser      # some

`.ci/run` calls it after `make test`, and what that has run just so is not run again.

Suites of one lane run one after the other. Output is in build/gate/, and of a suite that fails it
is shown. At the end: a table of suites, what was skipped and why, and tests that no suite has run.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import threading
import time
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import pytest

from tests.support.paths import ROOT

OUTPUT = ROOT / "build" / "gate"
# The gate's figures are in tests/support/effort.py.
SIZE = {"MRBT_TESTS": "gate"}
PROGRESS_S = 60.0
# A suite that hangs is ended; its tests end by themselves long before. The longest takes half an
# hour on two cores, and some machines are half as fast.
LIMIT_S = 75 * 60


@dataclass(frozen=True)
class Suite:
    """One call of pytest. `lane`: runs after the suites before it in the same lane.

    `environment` comes on top of the size. A suite that only computes is `nice`, so that teams of
    real processes are not kept waiting.
    """

    name: str
    lane: str
    arguments: tuple[str, ...]
    environment: Mapping[str, str] = field(default_factory=dict)
    is_nice: bool = False


# An option of tests/conftest.py.
BEYOND_QUICK = ("--beyond-quick",)
# They get what the others leave of the processors, so their limit of time is a wider one.
COMPUTING = ("-n", "2", "--dist", "worksteal", "--timeout", "1200")
OF_PROCESSES = ("tests/processes", "tests/adapters/ros2/bridge")
SUITES = (
    Suite(
        "tests",
        "computing",
        (*COMPUTING, *BEYOND_QUICK, "-m", "not processes and not docker"),
        is_nice=True,
    ),
    Suite(
        "plain",
        "computing",
        (*COMPUTING, "-m", "not processes", "tests/core/agent", "tests/observer", "tests/sim"),
        # In the larger size plans are compared with the plain ones anyway, byte for byte (I7 in
        # chaos: each; elsewhere a quarter, tests/sim/conftest.py), and whole runs effect for effect
        # (tests/sim/test_run_engines.py).
        {"MRBT_PLAIN": "1", "MRBT_TESTS": "quick"},
        is_nice=True,
    ),
    Suite("processes", "waiting", ("-n", "3", "-m", "processes and not soak", *OF_PROCESSES)),
    Suite("browser", "waiting", ("-n", "2", "tests/browser")),
    Suite("docker", "waiting", ("tests/docker",)),
    Suite("environments", "waiting", ("-n", "2", "--dist", "loadgroup", "tests/environments")),
    Suite("soak", "soaking", ("-m", "soak", "tests/processes")),
)


@dataclass
class Outcome:
    """What came of a suite. `ran` and `skipped` are tests; `reasons` counts why they were."""

    status: int = 0
    seconds: float = 0.0
    ran: set[str] = field(default_factory=set)
    skipped: set[str] = field(default_factory=set)
    reasons: Counter[str] = field(default_factory=Counter)


def run_suite(suite: Suite) -> Outcome:
    """Run one suite to its end, into its file."""
    report, log = OUTPUT / f"{suite.name}.xml", OUTPUT / f"{suite.name}.log"
    command = [sys.executable, "-m", "pytest", f"--junitxml={report}", *suite.arguments]
    if suite.is_nice:
        command = ["nice", "-n", "15", *command]
    report.unlink(missing_ok=True)  # of an earlier run
    begun_s = time.monotonic()
    with log.open("w", encoding="utf-8") as file:
        try:
            done = subprocess.run(
                command,
                cwd=ROOT,
                env=os.environ | SIZE | suite.environment,
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
                timeout=LIMIT_S,
                check=False,
            )
            # A suite that selects nothing leaves out nothing: `summary` compares all tests.
            status = 0 if done.returncode == pytest.ExitCode.NO_TESTS_COLLECTED else done.returncode
        except subprocess.TimeoutExpired:
            status = 124
    outcome = Outcome(status, time.monotonic() - begun_s)
    if report.exists():
        read_report(report.read_text(encoding="utf-8"), outcome)
    return outcome


def read_report(text: str, outcome: Outcome) -> None:
    """Take in what a JUnit report tells of each test."""
    for case in ElementTree.fromstring(text).iter("testcase"):
        test = f"{case.get('classname')}::{case.get('name')}"
        skipped = case.find("skipped")
        if skipped is None:
            outcome.ran.add(test)
        else:
            outcome.skipped.add(test)
            outcome.reasons[(skipped.get("message") or "").removeprefix("Skipped: ")] += 1


def run_lanes(suites: Sequence[Suite]) -> dict[str, Outcome]:
    """Run all suites; their outcomes by name, in the order in which they ended."""
    outcomes: dict[str, Outcome] = {}

    def run_lane(lane: str) -> None:
        for suite in suites:
            if suite.lane == lane:
                outcomes[suite.name] = outcome = run_suite(suite)
                said = "passed" if outcome.status == 0 else f"FAILED ({outcome.status})"
                show(f"{suite.name} {said} after {outcome.seconds:.0f} s")
                if outcome.status:
                    show(tail(suite, 200))

    lanes = dict.fromkeys(suite.lane for suite in suites)
    threads = [threading.Thread(target=run_lane, args=(lane,)) for lane in lanes]
    for thread in threads:
        thread.start()
    begun_s = time.monotonic()
    for thread in threads:
        while thread.is_alive():
            thread.join(PROGRESS_S)
            under_way = [suite for suite in suites if suite.name not in outcomes]
            if thread.is_alive():
                at = ", ".join(f"{suite.name} {percent(suite)}" for suite in under_way)
                show(f"{time.monotonic() - begun_s:5.0f} s: {at}")
    return outcomes


def tail(suite: Suite, lines: int) -> str:
    """The last lines that a suite has printed."""
    log = OUTPUT / f"{suite.name}.log"
    text = log.read_text(encoding="utf-8", errors="replace") if log.exists() else ""
    return "\n".join(text.splitlines()[-lines:])


def percent(suite: Suite) -> str:
    """How far a suite is, as pytest has last said."""
    said = re.findall(r"\[ *(\d+%)\]", tail(suite, 3))
    return said[-1] if said else "begun" if tail(suite, 1) else "waits"


def table(outcomes: Mapping[str, Outcome]) -> Iterator[str]:
    """A line per suite."""
    yield f"{'suite':<20}{'tests':>8}{'skipped':>9}{'seconds':>9}"
    for name, outcome in outcomes.items():
        ran, skipped = len(outcome.ran), len(outcome.skipped)
        mark = "" if outcome.status == 0 else "   FAILED"
        yield f"{name:<20}{ran:>8}{skipped:>9}{outcome.seconds:>9.0f}{mark}"


def collected() -> set[str]:
    """Every test there is at this size but those that `make test` has run, as reports name them."""
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", *BEYOND_QUICK]
    command += ["-o", "addopts=--import-mode=importlib"]
    done = subprocess.run(
        command, cwd=ROOT, env=os.environ | SIZE, capture_output=True, text=True, check=False
    )
    found = {name_of(line) for line in done.stdout.splitlines() if "::" in line}
    if done.returncode not in (0, pytest.ExitCode.NO_TESTS_COLLECTED):
        raise SystemExit(f"tests cannot be collected:\n{done.stdout[-3000:]}{done.stderr}")
    return found


def name_of(node: str) -> str:
    """`tests/a/test_b.py::TestC::test_d` as reports name it: `tests.a.test_b.TestC::test_d`."""
    name, bracket, values = node.partition("[")
    path, *classes, test = name.split("::")
    place = ".".join([path.removesuffix(".py").replace("/", "."), *classes])
    return f"{place}::{test}{bracket}{values}"


def show(text: str) -> None:
    print(text, flush=True)  # noqa: T201


def summary(outcomes: Mapping[str, Outcome], existing: set[str]) -> tuple[list[str], bool]:
    """What is shown at the end, and whether all is well: of suites by name, and of all tests."""
    lines = []
    reasons: Counter[str] = Counter()
    for outcome in outcomes.values():
        reasons.update(outcome.reasons)
    lines += ["", "skipped, and why:" if reasons else "nothing was skipped"]
    lines += [f"{count:6} {reason}" for reason, count in reasons.most_common()]
    tried = [outcome.ran | outcome.skipped for outcome in outcomes.values()]
    missing = existing.difference(*tried)
    lines += [f"no suite has run {test}" for test in sorted(missing)]
    is_well = not missing and all(outcome.status == 0 for outcome in outcomes.values())
    ran = sum(len(outcome.ran) for outcome in outcomes.values())
    verdict = "passed" if is_well else "FAILED"
    lines += ["", *table(outcomes)]
    lines += ["", f"{verdict}: {ran} tests, {sum(reasons.values())} skipped"]
    return lines, is_well


def main(names: Sequence[str]) -> int:
    """Run suites, all if none is named; the exit status."""
    suites = [suite for suite in SUITES if suite.name in names or not names]
    OUTPUT.mkdir(parents=True, exist_ok=True)
    outcomes = run_lanes(suites)
    lines, is_well = summary(
        {suite.name: outcomes[suite.name] for suite in suites}, set() if names else collected()
    )
    show("\n".join(lines))
    return 0 if is_well else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
