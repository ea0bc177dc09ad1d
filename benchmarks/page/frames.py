"""Frame times and memory of the page: server and page are the real ones, the team is made up."""

from __future__ import annotations

import asyncio
import multiprocessing
import random
import socket
import statistics
import time
from typing import Any

import uvicorn

from benchmarks.page.chromium import chromium
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.bt.tree import Kind, NodeSpec, build_tree
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.mission.mission import MICRO, GlobalTask, Mission, Need, Robot
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.views.model.team_view import TeamView
from mrbt_mesh.views.web.app import Page
from mrbt_mesh.views.web.feed import Feed
from mrbt_mesh.views.web.protection import own_names

ROBOTS, SECTIONS, LEAVES = 64, 133, 14
CHANGES_PER_S, NODES_PER_CHANGE = 10, 200
FRAMES = """async (seconds) => {
  const times = [];
  let last = performance.now(), end = last + seconds * 1000;
  await new Promise((done) => requestAnimationFrame(function frame(now) {
    times.push(now - last); last = now;
    if (now < end) requestAnimationFrame(frame); else done();
  }));
  return times.slice(1);
}"""


def mission() -> Mission:
    """A tree of about 2,000 nodes for 64 robots."""
    names = [f"work_{i}_{j}" for i in range(SECTIONS) for j in range(LEAVES)]
    leaves = [NodeSpec(Kind.ACTION, subject=name) for name in names]
    sections = tuple(
        NodeSpec(Kind.SEQUENCE, tuple(leaves[i * LEAVES : (i + 1) * LEAVES]), name=f"section {i}")
        for i in range(SECTIONS)
    )
    tree = build_tree(NodeSpec(Kind.PARALLEL, sections, limit=len(sections)))
    table = {"work": MICRO}
    robots = {name: Robot(name, "worker", table) for name in map("R{:02d}".format, range(ROBOTS))}
    tasks = {name: GlobalTask(name, (Need("work", 1, 1),)) for name in names}
    return Mission("large", robots, {"worker": table}, {}, {}, tasks, tree)


class _MadeUp:
    """Changes ten times a second, as a large team at work would make them."""

    def __init__(self, feed: Feed) -> None:
        self._feed = feed
        self._random = random.Random(1)
        self._spans: dict[str, tuple[int, dict[str, Any]]] = {}
        self._count = 0
        self._begun_s = time.monotonic()

    def change(self) -> None:
        put, rng = self._feed.view.changes.put, self._random
        now_s = time.monotonic() - self._begun_s
        nodes = self._feed.observer.mission.tree.nodes
        for node in rng.sample(range(len(nodes)), NODES_PER_CHANGE):
            robots = [f"R{rng.randrange(ROBOTS):02d}"]
            put(f"node/{node}", [rng.randrange(4), robots, "", rng.randrange(1, 4)])
        for number in range(ROBOTS):
            robot = f"R{number:02d}"
            put(f"robot/{robot}", _robot(rng, number))
            put(f"position/{robot}", {"x": rng.random() * 9, "y": rng.random() * 9, "heading": 0.1})
        robot = f"R{rng.randrange(ROBOTS):02d}"
        if robot in self._spans:
            index, span = self._spans[robot]
            put(f"work/{index}", span | {"ended_s": now_s, "end": "done"})
        span = {"robot": robot, "global_task": "work_1_1", "local_task": "work"}
        span |= {"claimed_s": now_s, "running_s": now_s, "ended_s": None, "end": None}
        self._spans[robot] = self._count, span
        put(f"work/{self._count}", span)
        put(f"event/{self._count}", {"at_s": now_s, "text": f"{robot}: work for work_1_1"})
        self._count += 1
        self._feed.wake()


def _robot(rng: random.Random, number: int) -> dict[str, Any]:
    return {
        "state": "alive",
        "type": "worker",
        "capabilities": {"work": 1.0},
        "lost": {},
        "pending": {},
        "local_task": "work",
        "global_task": f"work_{number}_1",
        "phase": "running",
        "progress": rng.randrange(101),
        "statuses": ["running", "success", "running", "running"],
        "idle": "",
        "differs_since_s": None,
    }


def _serve(bound: socket.socket, feed: Feed) -> None:
    async def main() -> None:
        own_hosts = own_names(["127.0.0.1"], bound.getsockname()[1])
        page = Page(feed, own_hosts, None, "").application()
        server = uvicorn.Server(uvicorn.Config(page, lifespan="off", log_config=None))
        serving = asyncio.create_task(server.serve([bound]))
        made_up = _MadeUp(feed)
        while not serving.done():
            made_up.change()
            await asyncio.sleep(1 / CHANGES_PER_S)

    asyncio.run(main())


def measure(seconds: float) -> dict[str, Any]:
    """Frame times in ms, and the heap in MB after `seconds`."""
    observer = Observer(mission(), "r", Timing(200_000, 1_000_000), default_solver)
    observer.record.started_us = boottime_us()
    feed = Feed(TeamView(observer), boottime_us)
    feed.update()
    bound = socket.create_server(("127.0.0.1", 0))
    # A process of its own, as it is: the server's work is not the page's.
    server = multiprocessing.get_context("fork").Process(target=_serve, args=(bound, feed))
    server.start()
    with chromium() as browser:
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        page.goto(f"http://127.0.0.1:{bound.getsockname()[1]}/")
        page.wait_for_selector('.card:has-text("R63")')
        page.uncheck("#fold-finished")
        page.click("#unfold-all")
        times = sorted(page.evaluate(FRAMES, seconds))
        heap = page.evaluate("() => { gc(); return performance.memory.usedJSHeapSize; }")
        version = browser.version
    server.terminate()
    return {
        "seconds": seconds,
        "nodes": len(observer.mission.tree.nodes),
        "frames": len(times),
        "median_ms": round(statistics.median(times), 1),
        "p95_ms": round(times[int(len(times) * 0.95)], 1),
        "max_ms": round(times[-1], 1),
        "heap_mb": round(heap / 1e6, 1),
        "chromium": version,
    }
