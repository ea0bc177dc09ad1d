"""Rounds of killing a whole team at random moments and resuming it, on real processes.

    python -m benchmarks.resume [--rounds 50] [--seed 1] [--json FILE]

The exit status is 1 if anything was lost or repeated.
Each round starts a team of the vehicle repair, kills all its robots (SIGKILL) at a random
moment, and resumes it with `mrbt up --run-dir SAME --resume`; in every second round, on the
average, the resumed team is killed and resumed once more. The figures come from events.jsonl and
from the journals as the kills left them:

lost      successes that a journal held at a kill and none holds at the end, and missions that
          did not succeed
repeated  local tasks that were started again although a journal held their success
in gap    kills between an action's end and the commit of its outcome: that action had ended in
          the world without a trace in any journal
"""

from __future__ import annotations

import random
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.report import run_program, say
from benchmarks.run import REPAIR, Run
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.drills.inject import InjectedFaults, JournalsAtDeath
from mrbt_mesh.drills.journals import read
from mrbt_mesh.drills.judge import losses, repeats, unjournaled
from mrbt_mesh.drills.physical import spans
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.run_dir import RunDir

SPEED = "4"


@dataclass
class Round:
    """One round. Times in s since all robots had a process; counts of local tasks."""

    seed: int
    killed_at_s: list[float]
    result: str = ""
    successes: int = 0
    journaled: int = 0
    lost: int = 0
    repeated: int = 0
    in_gap: int = 0
    kills_in_gap: int = 0


def play(mission: Mission, seed: int, duration_s: float) -> Round:
    """One round; `duration_s` is what an undisturbed team needs."""
    draw = random.Random(seed)
    moments_s = [draw.uniform(0, duration_s)]
    if draw.random() < 0.5:
        moments_s.append(draw.uniform(0, duration_s))
    done = Round(seed, [])
    injected = InjectedFaults()
    with tempfile.TemporaryDirectory(prefix="mrbt-bench-") as folder:
        run = Run(Path(folder), REPAIR, "--speed", SPEED)
        for moment_s in moments_s:
            at_death = _kill_at(run, mission, moment_s)
            run.end()
            if at_death is not None:
                done.killed_at_s.append(round(moment_s, 3))
                injected.journals_at_death.append(at_death)
            run = Run(Path(folder), REPAIR, "--speed", SPEED, "--continue")
        summary = run.end()
        found = spans(run.events())
        run_dir = RunDir(run.folder)
        journals = read(run.folder, run_dir.robots(), mission.digest, run_dir.info().run)
    then = {d for s in injected.journals_at_death for held in s.journals.values() for d in held}
    gaps = unjournaled(found, injected)
    done.result = summary["result"]
    done.successes = sum(span.end == "success" for span in found)
    done.journaled = len(then)
    done.lost = len(losses(injected, journals))
    done.repeated = len(repeats(mission, found, injected))
    done.in_gap = len(gaps)
    done.kills_in_gap = sum(
        any(_fell_between(span.end_s, index, injected) for span in gaps)
        for index in range(len(injected.journals_at_death))
    )
    return done


def _fell_between(end_s: float, index: int, injected: InjectedFaults) -> bool:
    """Whether an action ended after the kill before this one, and before this one."""
    before_s = injected.journals_at_death[index - 1].unix_s if index else 0.0
    return before_s < end_s <= injected.journals_at_death[index].unix_s


def _kill_at(run: Run, mission: Mission, moment_s: float) -> JournalsAtDeath | None:
    """Kill all robots at a moment; None if they had ended before."""
    run.wait_for_processes(len(mission.robots))
    time.sleep(moment_s)
    killed = run.kill()
    if not killed:
        return None
    now_s = time.time()
    info = RunDir(run.folder).info()
    return JournalsAtDeath(now_s, read(run.folder, killed, mission.digest, info.run))


def undisturbed_s() -> float:
    """Seconds that a team needs once all robots have a process."""
    with tempfile.TemporaryDirectory(prefix="mrbt-bench-") as folder:
        run = Run(Path(folder), REPAIR, "--speed", SPEED)
        run.wait_for_processes(6)
        begun_s = time.time()
        run.end()
        return float(run.events()[-1]["t"]) - begun_s


def totals(rounds: list[Round]) -> dict[str, Any]:
    """The figures of all rounds."""
    kills = sum(len(r.killed_at_s) for r in rounds)
    return {
        "rounds": len(rounds),
        "kills": kills,
        "missions_succeeded": sum(r.result == "success" for r in rounds),
        "journaled_at_kills": sum(r.journaled for r in rounds),
        "lost": sum(r.lost + (r.result != "success") for r in rounds),
        "repeated": sum(r.repeated for r in rounds),
        "kills_in_gap": sum(r.kills_in_gap for r in rounds),
        "actions_in_gap": sum(r.in_gap for r in rounds),
    }


def measure(rounds: int = 50, seed: int = 1) -> dict[str, Any]:
    """Play the rounds; `seed` is that of the first one."""
    mission = load_mission(REPAIR)
    duration_s = undisturbed_s()
    say(f"an undisturbed team needs {duration_s:.1f} s")
    played: list[Round] = []
    while len(played) < rounds:
        done = play(mission, seed, duration_s)
        seed += 1
        if not done.killed_at_s:
            say(f"seed {done.seed}: the mission was over before the kill; another one")
            continue
        played.append(done)
        say(f"round {len(played)}/{rounds}: {asdict(done)}")
    return {
        "undisturbed_s": round(duration_s, 3),
        "totals": totals(played),
        "rounds": [asdict(done) for done in played],
    }


if __name__ == "__main__":
    found = run_program(__doc__, measure)["totals"]
    raise SystemExit(1 if found["lost"] or found["repeated"] else 0)
