"""A team of processes with its page open for minutes: what grows, and what watching costs."""

from __future__ import annotations

import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import psutil

from benchmarks.page.chromium import chromium
from benchmarks.page.frames import FRAMES
from benchmarks.page.situations import address, inspection
from benchmarks.run import cpu_s
from tests.support.team import Team

# What is left out at the begin: the launch, and the first drawing of everything.
SETTLE_S, LOOK_S = 30.0, 10.0
_HEAP = "() => { gc(); return performance.memory.usedJSHeapSize; }"


def measure(seconds: float, robots: int) -> dict[str, Any]:
    """Frames of the last `LOOK_S` in ms, memory over time in MB, and processor shares."""
    folder = tempfile.TemporaryDirectory(prefix="mrbt-watched-")
    with folder, Team(Path(folder.name)) as team, chromium() as browser:
        mission = inspection(team.folder, robots, robots)
        team.mrbt("up", str(mission), "--detach", "--run-dir", str(team.run_dir))
        team.wait_for_event("scan")
        web = team.start("watch", "--web", "--run-dir", str(team.run_dir), "--port", "0")
        assert web.stdout is not None
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        problems: list[str] = []
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on("console", lambda m: problems.append(m.text) if m.type == "error" else None)
        page.goto(address(web.stdout.readline()))
        page.wait_for_selector(".card .task:not(.none)")
        page.wait_for_timeout(SETTLE_S * 1e3)
        team_of = [psutil.Process(team.pid(robot)) for robot in team.robots()]
        server = psutil.Process(web.pid)
        heap_mb, rss_mb = [page.evaluate(_HEAP) / 1e6], [server.memory_info().rss / 1e6]
        spent_s, began_s = [cpu_s(team_of), cpu_s([server])], time.monotonic()
        while time.monotonic() < began_s + seconds - LOOK_S:
            page.wait_for_timeout(min(60.0, seconds / 10) * 1e3)
            heap_mb.append(page.evaluate(_HEAP) / 1e6)
            rss_mb.append(server.memory_info().rss / 1e6)
        times = sorted(page.evaluate(FRAMES, LOOK_S))
        took_s = time.monotonic() - began_s
        spent_s = [cpu_s(team_of) - spent_s[0], cpu_s([server]) - spent_s[1]]
        events = len(team.events())
    return {
        "robots": robots,
        "seconds": round(took_s),
        "events": events,
        "console_errors": problems,
        "frame_median_ms": round(statistics.median(times), 1),
        "frame_p95_ms": round(times[int(len(times) * 0.95)], 1),
        "heap_mb": [round(each, 1) for each in heap_mb],
        "server_mb": [round(each, 1) for each in rss_mb],
        "team_cpu_percent": round(100 * spent_s[0] / took_s, 1),
        "server_cpu_percent": round(100 * spent_s[1] / took_s, 1),
    }
