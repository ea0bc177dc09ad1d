"""Processor time of `mrbt watch --web`, with a page open, beside that of the team."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from typing import Any

import psutil

from benchmarks.run import REPAIR, cpu_s


def _listen(url: str) -> None:
    """A page that takes whatever comes."""
    with urllib.request.urlopen(f"{url}events") as stream:
        while stream.read(4_096):
            pass


def measure(seconds: float) -> dict[str, Any]:
    """Processor seconds of both in `seconds`, and the share in percent."""
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"MRBT_STATE_DIR": folder}
        mrbt = [sys.executable, "-m", "mrbt_mesh"]
        mission = str(REPAIR)
        subprocess.run(
            [*mrbt, "up", mission, "--detach", "--speed", str(20 / seconds)],
            env=environment,
            check=True,
            stdout=subprocess.DEVNULL,
        )
        watch = [*mrbt, "watch", "--web"]
        web = subprocess.Popen(watch, env=environment, stdout=subprocess.PIPE, text=True)
        assert web.stdout is not None
        found = re.search(r"web: (\S+)", web.stdout.readline())
        assert found is not None
        threading.Thread(target=_listen, args=(found[1],), daemon=True).start()
        done = subprocess.run(
            [*mrbt, "status", "--json"], env=environment, check=True, capture_output=True
        )
        robots = [psutil.Process(r["pid"]) for r in json.loads(done.stdout)["robots"].values()]
        page = [psutil.Process(web.pid)]
        team_s, web_s = cpu_s(robots), cpu_s(page)
        time.sleep(seconds)
        team_s, web_s = cpu_s(robots) - team_s, cpu_s(page) - web_s
        web.terminate()
        subprocess.run([*mrbt, "abort"], env=environment, check=False, capture_output=True)
        web.wait()
        psutil.wait_procs(robots, timeout=10)
    return {
        "seconds": seconds,
        "team_cpu_s": round(team_s, 2),
        "web_cpu_s": round(web_s, 2),
        "share_percent": round(100 * web_s / team_s, 1),
    }
