"""Holds all drills, and verifies what their robots have recorded.

    python -m benchmarks.verified_drills [--quick] [DRILL.yaml ...]

Exit status 1 if a recording is not proved: a false alarm, since nobody has falsified any. Drills
that this machine cannot hold (networks need root on Linux) are skipped, and told.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile

from benchmarks.report import ROOT, say


def main() -> None:
    """Hold the drills, verify each run's directory, tell what was not proved."""
    chosen = sys.argv[1:] or ["--all"]
    mrbt = [sys.executable, "-m", "mrbt_mesh"]
    with tempfile.TemporaryDirectory(prefix="mrbt-verified-") as folder:
        report = subprocess.run(
            [*mrbt, "drill", *chosen, "--keep", "--json"],
            cwd=ROOT,
            env=os.environ | {"MRBT_STATE_DIR": folder},
            stdout=subprocess.PIPE,
            check=False,
        )
        alarms, verified = 0, 0
        for run in json.loads(report.stdout)["runs"]:
            if run["run_dir"] is None:
                say(f"{run['drill']}: not held")
                continue
            done = subprocess.run(
                [*mrbt, "recording", "verify", run["run_dir"], "--json"],
                stdout=subprocess.PIPE,
                check=False,
            )
            verdict = json.loads(done.stdout)
            verified += 1
            say(f"{run['drill']}: {len(verdict['findings'])} findings, {verdict['counts']}")
            if not verdict["verified"]:
                alarms += 1
                say(json.dumps(verdict["findings"][:5] + verdict["not_proved"], indent=2))
    say(f"{verified} drills verified, {alarms} with findings")
    raise SystemExit(1 if alarms or not verified else 0)


if __name__ == "__main__":
    main()
