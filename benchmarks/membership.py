"""Who is thought dead, how soon, and how fast a team agrees, on networks from good to hopeless.

    python benchmarks/membership.py [--full | --long] [--jobs 2] [--json FILE] [--write-docs]

Virtual time; the robots are the real agents with the default knobs. Beside them stands a plain
detector that sees the same beats: dead after the detection time without a beat of the robot
itself. `--full` runs longer and takes hours; `--write-docs` puts the tables into
docs/membership.md.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import statistics
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from mrbt_mesh.core.effects import ActionFinished, CapabilityChanged
from mrbt_mesh.core.membership import State
from mrbt_mesh.core.mission import Mission
from mrbt_mesh.core.timing import Timing
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.sim.mesh import Mesh, Node
from mrbt_mesh.sim.network import Link, LinkKnobs, NetworkKnobs

DOCS = Path(__file__).resolve().parents[1] / "docs" / "membership.md"
MARKS = ("<!-- measured: begin -->", "<!-- measured: end -->")
SECOND_US = 1_000_000
TIMING = Timing()
WARM_UP_US = 10 * SECOND_US
GIVE_UP_US = 10 * SECOND_US

MISSION = """\
mission: at_work
program: robot.py
parameters: {{areas: [{areas}]}}
local_tasks: {{explore: {{parameters: [area], work: 1}}}}
robot_types: {{R: {{capabilities: {{explore: 1}}}}}}
robots: {{{robots}}}
global_tasks: {{visit: {{parameters: [area], needs: {{explore($area): {{min: 1, max: 1}}}}}}}}
tree:
  Parallel:
    success: all
    for_each: {{area: $areas}}
    do: visit($area)
"""


@cache
def mission(robots: int, areas: int) -> Mission:
    """So many robots, and so many areas for them to visit."""
    with tempfile.TemporaryDirectory(prefix="mrbt-bench-") as folder:
        path = Path(folder) / "mission.yaml"
        (Path(folder) / "robot.py").write_text("")
        names = ", ".join(f"{name(i)}: R" for i in range(robots))
        path.write_text(
            MISSION.format(robots=names, areas=", ".join(f"a{i}" for i in range(areas)))
        )
        return load_mission(path)


def name(number: int) -> str:
    return f"R{number:02d}"


@dataclass(frozen=True)
class Net:
    """One kind of network; `links` are those that break after the start, as `0>1` or `0-1`."""

    loss_percent: int = 0
    jitter_ms: int = 0
    links: str = ""

    def knobs(self) -> NetworkKnobs:
        """No tokens: what is measured here is what beats alone can tell."""
        link = LinkKnobs(
            jitter_us=1_000 * (self.jitter_ms or 1), loss_permille=10 * self.loss_percent
        )
        return NetworkKnobs(link, token_delay_us=None)

    def blocked(self) -> list[Link]:
        found = []
        for text in self.links.split():
            one, other = name(int(text[0])), name(int(text[2]))
            found += [(one, other)] + [(other, one)] * (text[1] == "-")
        return found

    def __str__(self) -> str:
        parts = [f"{self.loss_percent} % loss"]
        if self.jitter_ms:
            parts.append(f"{self.jitter_ms} ms jitter")
        if self.links:
            broken = "broken link" if "-" in self.links else "one-way link"
            parts.append(broken + "s" * (len(self.links.split()) > 1))
        return ", ".join(parts)


GRADED = [Net(loss, jitter) for jitter in (0, 200) for loss in (0, 10, 20, 30, 40, 50)]
BROKEN = [Net(*rough, links) for links in ("0>1", "0-1") for rough in ((0, 0), (30, 200))]
BAD = Net(30, 200)


# -- verdicts ---------------------------------------------------------------------------------


@dataclass
class Verdicts:
    """What both detectors made of one kind of network, over some runs of one team size."""

    minutes: float = 0.0
    false: int = 0
    plain_false: int = 0
    detection_us: list[int] = field(default_factory=list)
    plain_detection_us: list[int] = field(default_factory=list)

    def add(self, other: Verdicts) -> None:
        self.minutes += other.minutes
        self.false += other.false
        self.plain_false += other.plain_false
        self.detection_us += other.detection_us
        self.plain_detection_us += other.plain_detection_us


class Watch:
    """Follows both detectors of every robot while a mesh runs."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self.found = Verdicts()
        self._dead: set[Link] = set()
        self._beat_us: dict[Link, int] = {}
        self._frozen_us: dict[str, int] = {}
        mesh.on_step = self._step
        mesh.on_beat = self._beat

    def _step(self, node: Node, now_us: int) -> None:
        for robot, peer in node.agent.membership.peers.items():
            pair = (robot, node.agent.me)
            if peer.state is not State.DEAD:
                self._dead.discard(pair)
            elif pair not in self._dead:
                self._dead.add(pair)
                if robot in self._frozen_us:
                    self.found.detection_us.append(now_us - self._frozen_us[robot])
                else:
                    self.found.false += 1

    def _beat(self, source: str, target: str, now_us: int) -> None:
        silent_us = now_us - self._beat_us.get((source, target), now_us)
        self.found.plain_false += silent_us >= TIMING.detection_us
        self._beat_us[source, target] = now_us

    def freeze(self, robot: str) -> None:
        self._frozen_us[robot] = self.mesh.now_us
        self.mesh.freeze(robot)

    def close(self) -> Verdicts:
        """The plain detector's times follow from the last beat that each robot received."""
        silent = set(self.mesh.network.blocked)
        for (source, target), last_us in self._beat_us.items():
            due_us = last_us + TIMING.detection_us
            if (source, target) in silent:
                self.found.plain_false += source not in self._frozen_us  # and for ever
            elif source in self._frozen_us and target not in self._frozen_us:
                # One that was held for dead already at the freeze is found in no time.
                self.found.plain_detection_us.append(max(0, due_us - self._frozen_us[source]))
        return self.found


def verdicts(robots: int, net: Net, rest_s: int, victims: int, seed: int) -> Verdicts:
    """A team at rest for a while; then some robots freeze, one after the other."""
    mesh = Mesh(mission(robots, 1), net.knobs(), seed)
    watch = Watch(mesh)
    choose = random.Random(f"victims/{seed}")
    mesh.launch_all()
    mesh.run_until(min(WARM_UP_US, rest_s * SECOND_US))
    mesh.network.block(net.blocked())
    mesh.run_until(rest_s * SECOND_US)
    watch.found.minutes = rest_s / 60
    # Of three robots, the third that the ends of a broken link have to ask must stay.
    candidates = range(1) if net.links and robots == 3 else range(robots)
    for victim in choose.sample(candidates, victims):
        mesh.run_until(mesh.now_us + choose.randrange(TIMING.beat_us))
        watch.freeze(name(victim))
        mesh.run_until(mesh.now_us + TIMING.longest_verdict_us + SECOND_US)
    return watch.close()


# -- agreement --------------------------------------------------------------------------------


class Drill:
    """Events befall a team at work; each is timed until every living robot may start.

    That is: all have the same plan, and each has heard it of all others.
    """

    KINDS = ("outcome", "minor fault", "outcome", "recovery", "death", "join")

    def __init__(self, robots: int, net: Net, events: int, seed: int) -> None:
        # Not work for all: planning for it would take most of the benchmark's time.
        self.mesh = Mesh(mission(robots, 6 + events // 2), net.knobs(), seed)
        self.mesh.on_step = self._step
        self.times_us: dict[str, list[int]] = {}
        self._random = random.Random(f"drill/{seed}")
        self._events = events
        self._since_us: int | None = None
        self._agreed = True
        self._agreed_us = 0
        self._dead = ""
        self._faulty: Node | None = None

    def run(self) -> dict[str, list[int]]:
        """Kind of event -> times."""
        self.mesh.launch_all()
        self.mesh.run_until(WARM_UP_US)
        for number in range(self._events):
            kind = self.KINDS[number % len(self.KINDS)]
            self._agreed = False
            self._since_us = self.mesh.now_us
            if not self._befall(kind):
                continue
            end_us = self.mesh.now_us + GIVE_UP_US
            while not self._agreed and self.mesh.now_us < end_us:
                self.mesh.run_until(self.mesh.now_us + 100_000)
            time_us = self._agreed_us if self._agreed else GIVE_UP_US
            self.times_us.setdefault(kind, []).append(time_us)
            self.mesh.run_until(self.mesh.now_us + SECOND_US + self._random.randrange(SECOND_US))
        return self.times_us

    def _befall(self, kind: str) -> bool:
        """Let it happen; False if it changes nothing, since nobody has to do anything else."""
        working = [node for node in self.mesh.living() if node.agent.work.action is not None]
        chosen = self._random.choice(working)
        match kind:
            case "outcome":
                assert chosen.agent.work.action is not None
                ticket = chosen.agent.work.action.number
                self.mesh.give(chosen, ActionFinished(ticket, True))
            case "minor fault":
                self._faulty = chosen
                self.mesh.give(chosen, CapabilityChanged("explore", lost=True))
            case "recovery":
                assert self._faulty is not None
                before = self._faulty.agent.plan
                self.mesh.give(self._faulty, CapabilityChanged("explore", lost=False))
                after = self._faulty.agent.plan
                return before is not None and after is not None and before.digest != after.digest
            case "death":
                self._dead, self._since_us = chosen.agent.me, None
                self.mesh.kill(self._dead)
            case _:
                self.mesh.launch(self._dead, sorted(self.mesh.mission.robots))
                self._dead = ""
        return True

    def _step(self, node: Node, now_us: int) -> None:
        if self._agreed:
            return
        if self._since_us is None:
            # A death counts from the first verdict: before, it is detection.
            if not self._is_buried(node):
                return
            self._since_us = now_us
        if self._is_settled():
            self._agreed = True
            self._agreed_us = now_us - self._since_us

    def _is_buried(self, node: Node) -> bool:
        return node.agent.membership.peers[self._dead].state is State.DEAD

    def _is_settled(self) -> bool:
        nodes = self.mesh.living()
        plans = [node.agent.plan for node in nodes if node.agent.joining is None]
        digests = {plan.digest for plan in plans if plan is not None}
        if len(plans) < len(nodes) or len(digests) != 1:
            return False
        if self._dead and not all(map(self._is_buried, nodes)):
            return False
        (digest,) = digests
        return all(node.agent.membership.agrees(digest) for node in nodes)


def agreement(robots: int, net: Net, events: int, seed: int) -> dict[str, list[int]]:
    return Drill(robots, net, events, seed).run()


# -- traffic ----------------------------------------------------------------------------------


def traffic(robots: int, net: Net, seed: int) -> dict[str, float]:
    """Copies sent per robot and second, and kB: at rest, and in the second after an outcome."""
    mesh = Mesh(mission(robots, 3), net.knobs(), seed)
    mesh.launch_all()
    mesh.run_until(6 * SECOND_US)
    found = {}
    for label, window_us in (("rest", 2 * SECOND_US), ("event", SECOND_US)):
        if label == "event":
            node = next(n for n in mesh.living() if n.agent.work.action is not None)
            assert node.agent.work.action is not None
            mesh.give(node, ActionFinished(node.agent.work.action.number, True))
        before = (sum(mesh.messages.values()), sum(mesh.bytes.values()))
        mesh.run_until(mesh.now_us + window_us)
        scale = robots * window_us / SECOND_US
        found[f"{label}_messages"] = (sum(mesh.messages.values()) - before[0]) / scale
        found[f"{label}_kb"] = (sum(mesh.bytes.values()) - before[1]) / scale / 1_000
    return found


# -- what is run ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Job:
    """One call in a process of its own."""

    kind: str
    robots: int
    net: Net
    arguments: tuple[int, ...]

    def run(self) -> Any:
        call = {"verdicts": verdicts, "agreement": agreement, "traffic": traffic}[self.kind]
        return call(self.robots, self.net, *self.arguments)  # type: ignore[operator]


def jobs(full: bool) -> Iterator[Job]:
    """Long ones first. Sizes: (robots, networks, seconds at rest, runs, victims)."""
    some = [Net(), Net(30), BAD, *(net for net in BROKEN if net.loss_percent)]
    sizes: list[tuple[int, Iterable[Net], int, int, int]] = [
        (64, (BAD,), 600 if full else 10, 1, 4 if full else 1),
        (32, GRADED + BROKEN if full else some, 600 if full else 12, 2 if full else 1, 4),
        (6, GRADED + BROKEN, 600, 20 if full else 1, 2),
        (6, GRADED + BROKEN, 20, 50 if full else 12, 2),
        (3, GRADED + BROKEN, 600, 100 if full else 3, 1),
        (3, GRADED + BROKEN, 20, 200 if full else 40, 1),
        (2, GRADED, 600, 100 if full else 3, 1),
        (2, GRADED, 20, 200 if full else 40, 1),
    ]
    yield Job("traffic", 64, Net(), (1,))
    for robots, net, runs, events in (
        (32, BAD, 20 if full else 2, 18),
        (32, Net(), 5 if full else 1, 6),
        (6, BAD, 100 if full else 10, 18),
        (6, Net(), 10, 18),
    ):
        for seed in range(runs):
            yield Job("agreement", robots, net, (events, seed))
    for robots in (32, 6):
        for net in (Net(), BAD):
            yield Job("traffic", robots, net, (1,))
    for robots, nets, rest_s, runs, victims in sizes:
        for net in nets:
            for seed in range(runs):
                yield Job("verdicts", robots, net, (rest_s, victims, 1_000 * rest_s + seed))


def long_jobs() -> Iterator[Job]:
    """Ten minutes of large teams on a bad network, with a broken link and a one-way link in it."""
    rough = Net(30, 200, "0>1 2-3")
    yield Job("verdicts", 64, rough, (600, 4, 3))
    yield Job("verdicts", 32, BAD, (600, 4, 1))
    yield Job("verdicts", 32, rough, (600, 0, 2))


def run_all(todo: list[Job], processes: int) -> dict[tuple[str, int, Net], list[Any]]:
    """All results by kind, size and network."""
    found: dict[tuple[str, int, Net], list[Any]] = {}
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    console = Console(stderr=True)
    with (
        Progress(*columns, TimeElapsedColumn(), console=console) as progress,
        ProcessPoolExecutor(processes) as pool,
    ):
        bar = progress.add_task("networks", total=len(todo))
        running = {pool.submit(job.run): job for job in todo}
        for future in as_completed(running):
            job = running[future]
            found.setdefault((job.kind, job.robots, job.net), []).append(future.result())
            progress.advance(bar)
    return found


# -- tables -----------------------------------------------------------------------------------


def spread_s(times_us: list[int]) -> dict[str, float]:
    """Median, 99th percentile and greatest, in seconds."""
    ordered = sorted(times_us)
    p99 = ordered[min(len(ordered) - 1, int(0.99 * len(ordered)))]
    return {
        "count": len(ordered),
        "median_s": round(statistics.median(ordered) / SECOND_US, 3),
        "p99_s": round(p99 / SECOND_US, 3),
        "max_s": round(ordered[-1] / SECOND_US, 3),
    }


def summary(found: dict[tuple[str, int, Net], list[Any]]) -> dict[str, list[dict[str, Any]]]:
    """Everything as plain data."""
    tables: dict[str, list[dict[str, Any]]] = {"verdicts": [], "agreement": [], "traffic": []}
    order = {net: index for index, net in enumerate([*GRADED, *BROKEN])}
    for kind, robots, net in sorted(found, key=lambda key: (key[0], key[1], order[key[2]])):
        results = found[kind, robots, net]
        row: dict[str, Any] = {"robots": robots, "network": str(net)}
        if kind == "verdicts":
            total = Verdicts()
            for result in results:
                total.add(result)
            row |= {"minutes": round(total.minutes, 1), "false": total.false}
            row["plain_false"] = total.plain_false
            row["detection"] = spread_s(total.detection_us)
            row["plain_detection"] = spread_s(total.plain_detection_us or [0])
        elif kind == "agreement":
            times: dict[str, list[int]] = {}
            for result in results:
                for event, each in result.items():
                    times.setdefault(event, []).extend(each)
                    times.setdefault("all", []).extend(each)
            row |= {event: spread_s(each) for event, each in sorted(times.items())}
        else:
            row |= {key: round(value, 1) for key, value in results[0].items()}
        tables[kind].append(row)
    return tables


def grid(head: list[str], rows: list[list[Any]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


def median_p99(spread: dict[str, float]) -> str:
    return f"{spread['median_s']:.2f} / {spread['p99_s']:.2f}"


def verdict_rows(rows: list[dict[str, Any]]) -> list[list[Any]]:
    return [
        [
            row["robots"],
            row["network"],
            f"{row['minutes']:g}",
            row["false"],
            row["plain_false"],
            median_p99(row["detection"]),
            median_p99(row["plain_detection"]),
        ]
        for row in rows
    ]


def markdown(tables: dict[str, list[dict[str, Any]]]) -> str:
    """All tables, for people."""
    head = ["robots", "network", "minutes", "false", "plain", "found after, s", "plain, s"]
    teams = [row for row in tables["verdicts"] if row["robots"] > 2]
    pairs = [row for row in tables["verdicts"] if row["robots"] == 2]
    kinds = [*sorted(set(Drill.KINDS)), "all"]
    agreed = [
        [
            row["robots"],
            row["network"],
            *(median_p99(row[kind]) if kind in row else "-" for kind in kinds),
        ]
        for row in tables["agreement"]
    ]
    columns = ("rest_messages", "rest_kb", "event_messages", "event_kb")
    sent = [
        [row["robots"], row["network"], *(row[c] for c in columns)] for row in tables["traffic"]
    ]
    return "\n\n".join(
        [
            "**Verdicts.** `minutes` of a team at rest, `false` verdicts on living robots in them "
            "(beside it those of the plain detector), and the time from a freeze until a robot "
            "has found it (median / 99th percentile).",
            grid(head, verdict_rows(teams)),
            "**Two robots**, where nobody else can be asked:",
            grid(head, verdict_rows(pairs)),
            "**Agreement.** Seconds from an event (a death: from the first verdict; a join: from "
            "the start of the process) until every living robot may start without its grace "
            "(median / 99th percentile).",
            grid(["robots", "network", *kinds], agreed),
            "**Traffic.** Copies sent per robot and second, and kB, at rest and in the second "
            "after an outcome.",
            grid(["robots", "network", "rest", "kB", "event", "kB"], sent),
        ]
    )


def write_docs(text: str) -> None:
    """Put the tables between the marks in docs/membership.md."""
    before, _, rest = DOCS.read_text().partition(MARKS[0])
    _, _, after = rest.partition(MARKS[1])
    DOCS.write_text(f"{before}{MARKS[0]}\n\n{text}\n\n{MARKS[1]}{after}")


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--full", action="store_true", help="more and longer runs: hours")
    parser.add_argument("--long", action="store_true", help="32 and 64 robots for 600 s: 30 min")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes (all cores)")
    parser.add_argument("--json", type=Path, help="also write the result here")
    parser.add_argument("--write-docs", action="store_true", help="update docs/membership.md")
    options = parser.parse_args()
    started = time.monotonic()
    todo = list(long_jobs() if options.long else jobs(options.full))
    tables = summary(run_all(todo, options.jobs))
    text = markdown(tables)
    sys.stdout.write(text + "\n")
    if options.json:
        result = {"seconds": round(time.monotonic() - started), "full": options.full, **tables}
        options.json.write_text(json.dumps(result, indent=2) + "\n")
    if options.write_docs:
        write_docs(text)


if __name__ == "__main__":
    main()
