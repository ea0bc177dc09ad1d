"""One broadcast and an exact plan everywhere, against an auction's rounds of bids."""

from __future__ import annotations

import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise, product
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from benchmarks.assignment import significant
from benchmarks.cbaa import Scores, cbaa, complete, flooding, judge, line, ring, slots
from benchmarks.instances import Density, Instance, Spec, Values, draw
from benchmarks.registry import Benchmark, Result, Setting, Table
from benchmarks.solvers import answer_ours, prepare_ours

ROBOTS = (6, 50, 200)
SEEDS = {6: 100, 50: 30, 200: 8}
QUICK_SEEDS = {6: 20, 50: 5, 200: 1}
# Demands per robot: few, so that robots are left over once lower bounds are met, or as many as
# there are robots, so that lower bounds take nearly all.
LOADS = {"roomy": 1 / 3.5, "tight": 1.0}
TITLES = {"roomy": "3.5 robots per demand offered", "tight": "one robot per demand offered"}
NETWORKS = {"complete": complete, "ring": ring, "line": line}
NETWORK_ROBOTS, NETWORK_SEEDS, QUICK_NETWORK_SEEDS = 50, 5, 1
EXACT, WITH_BONUS, PLAIN = "exact", "auction_bonus", "auction"
LABELS = {EXACT: "broadcast + exact", WITH_BONUS: "CBAA with bonus", PLAIN: "CBAA"}


@dataclass(frozen=True)
class Figures:
    """Of one instance and one way; `compute_ms` per robot; scores as ratios to the optimum."""

    rounds: int
    messages: int
    bytes: int
    score: float
    usable: float
    missed: int
    compute_ms: float


def record_bytes(instance: Instance) -> NDArray[np.int64]:
    """What each robot broadcasts: the demands it can serve and its performances, in msgpack."""
    edges = np.searchsorted(instance.robot, np.arange(instance.robots + 1))
    return np.array(
        [
            len(msgpack.packb([instance.demand[a:b].tolist(), instance.performance[a:b].tolist()]))
            for a, b in pairwise(edges)
        ]
    )


def exact(instance: Instance, links: NDArray[np.bool_]) -> tuple[Figures, int]:
    """(one broadcast per robot, then everybody solves; the optimum)."""
    problem = prepare_ours(instance)
    started_s = time.perf_counter()
    choice = answer_ours(problem)
    compute_s = time.perf_counter() - started_s
    optimum = instance.objective(choice)  # checks the bounds
    sent = flooding(links, record_bytes(instance))
    return _figures(sent, judge(instance, choice), optimum, compute_s), optimum


def auction(instance: Instance, links: NDArray[np.bool_], way: str, optimum: int) -> Figures:
    """An auction over the demands' slots."""
    tasks = slots(instance, bonus=way != PLAIN)
    started_s = time.perf_counter()
    outcome = cbaa(tasks.values, links, spread=True)
    compute_s = (time.perf_counter() - started_s) / instance.robots
    sent = outcome.rounds, outcome.messages, outcome.bytes
    return _figures(sent, judge(instance, tasks.choice(outcome)), optimum, compute_s)


def _figures(sent: tuple[int, int, int], scores: Scores, optimum: int, compute_s: float) -> Figures:
    return Figures(
        *sent,
        scores.score / optimum,
        scores.usable / optimum,
        scores.missed,
        compute_s * 1e3,
    )


def measure(
    spec: dict[str, Any], seeds: Sequence[int], load: float, network_name: str, ways: Sequence[str]
) -> dict[str, list[Figures]]:
    """Way -> figures, one per seed; the exact one is the measure of the others."""
    found: dict[str, list[Figures]] = {way: [] for way in ways}
    for seed in seeds:
        offered = max(1, round(spec["robots"] * load))
        instance = draw(Spec(offered=offered, seed=seed, **spec))
        links = NETWORKS[network_name](spec["robots"])
        best, optimum = exact(instance, links)
        for way in ways:
            found[way].append(best if way == EXACT else auction(instance, links, way, optimum))
    return found


def summary(figures: Sequence[Figures]) -> dict[str, float]:
    """Medians, and extremes where they show more."""
    columns = {each.name: [getattr(f, each.name) for f in figures] for each in fields(Figures)}
    found = {f"{name}_median": statistics.median(values) for name, values in columns.items()}
    for name in ("score", "usable"):
        found[f"{name}_min"] = min(columns[name])
    found["missed_max"] = max(columns["missed"])
    found["missed_mean"] = statistics.fmean(columns["missed"])
    found["rounds_max"] = max(columns["rounds"])
    return found


SCORES = ("score", "usable", "missed")
HEAD = (*("rounds", "messages", "MB"), *SCORES, "plain: rounds", *SCORES[1:])


def cells(of_way: dict[str, dict[str, float]]) -> list[str]:
    """A row of the table, as in HEAD, of CBAA with and without the bonus; ratios to the exact."""
    exact, bonus, plain = (of_way[way] for way in (EXACT, WITH_BONUS, PLAIN))
    messages, sent_bytes = bonus["messages_median"], bonus["bytes_median"]
    return [
        f"{bonus['rounds_median']:g}",
        f"{messages:,.0f} ({significant(messages / exact['messages_median'])})",
        f"{significant(sent_bytes / 1e6)} ({significant(sent_bytes / exact['bytes_median'])})",
        _spread(bonus, "score"),
        _spread(bonus, "usable"),
        f"{bonus['missed_mean']:.1f}",
        f"{plain['rounds_median']:g}",
        _spread(plain, "usable"),
        f"{plain['missed_mean']:.1f}",
    ]


def _spread(found: dict[str, float], name: str) -> str:
    return f"{found[f'{name}_min']:.3f}..{found[f'{name}_median']:.3f}"


def compare(
    spec: dict[str, Any], seeds: range, load: str, network_name: str
) -> tuple[list[dict[str, Any]], dict[str, dict[str, float]]]:
    """(rows of the figures, their summary by way) of one kind of instance on one network."""
    found = measure(spec, seeds, LOADS[load], network_name, tuple(LABELS))
    of_way = {way: summary(figures) for way, figures in found.items()}
    kind = {
        "robots": spec["robots"],
        "density": str(spec["density"]),
        "performances": str(spec["values"]),
        "load": load,
        "network": network_name,
        "instances": len(seeds),
    }
    return [{**kind, "way": way, **figures} for way, figures in of_way.items()], of_way


def run(setting: Setting) -> Result:
    """Measure all sizes on complete networks, and one size on other networks."""
    rows: list[dict[str, Any]] = []
    tables = []
    first = setting.seed
    seeds_of = QUICK_SEEDS if setting.quick else SEEDS
    for load in LOADS:
        shown = []
        for robots, density, values in product(ROBOTS, Density, Values):
            spec = {"robots": robots, "density": density, "values": values}
            found, of_way = compare(spec, range(first, first + seeds_of[robots]), load, "complete")
            rows += found
            shown.append([str(robots), density, values, *cells(of_way)])
            setting.say(f"  {load}: {robots} robots, {density}, performances {values}")
        title = f"CBAA, everybody hears everybody, {TITLES[load]}"
        tables.append(Table(title, ("robots", "density", "p", *HEAD), shown))
    exact = _exact_table(rows)
    others = QUICK_NETWORK_SEEDS if setting.quick else NETWORK_SEEDS
    spec = {"robots": NETWORK_ROBOTS, "density": Density.SPARSE, "values": Values.WIDE}
    shown = []
    for name in NETWORKS:
        found, of_way = compare(spec, range(first, first + others), "roomy", name)
        rows += found
        shown.append([name, f"{of_way[EXACT]['rounds_median']:g}", *cells(of_way)])
        setting.say(f"  {NETWORK_ROBOTS} robots, network {name}")
    title = f"Other networks: {NETWORK_ROBOTS} robots, sparse, p {Values.WIDE}, {TITLES['roomy']}"
    networks = Table(title, ("network", "flooding: rounds", *HEAD), shown)
    counts = ", ".join(f"{count} with {robots} robots" for robots, count in seeds_of.items())
    return Result(
        "one broadcast per robot, N(N-1) messages in one round, and the exact optimum",
        rows,
        [exact, *tables, networks],
        [NOTE, f"Instances per row: {counts}; on other networks {others}."],
    )


def _exact_table(rows: Sequence[dict[str, Any]]) -> Table:
    kind = {"load": "roomy", "performances": str(Values.WIDE), "way": EXACT}
    shown = [
        [
            str(row["robots"]),
            row["density"],
            f"{row['rounds_median']:g}",
            f"{row['messages_median']:,.0f}",
            f"{row['bytes_median'] / 1e6:.4f}",
            _spread(row, "score"),
            f"{row['missed_max']}",
        ]
        for row in rows
        if kind.items() <= row.items()
    ]
    head = ("robots", "density", "rounds", "messages", "MB", "score", "missed")
    title = f"One broadcast per robot and the exact plan ({TITLES['roomy']}, p {Values.WIDE})"
    return Table(title, head, shown)


NOTE = (
    "In brackets the ratio to one broadcast per robot, which is flooding on other networks. "
    "`rounds` until everybody holds the same lists and bids no more, as an onlooker sees it; the "
    "robots themselves need more to know. `MB`: payload of all messages in msgpack: the demands a "
    "robot can serve with its performances, or the auction's lists of bids and winners, which go "
    "out whole in each round. `score`: the sum of performances as a share of the optimum within "
    "the bounds, least and median (above 1 only where bounds are broken); `usable`: without the "
    "robots on demands whose lower bound is not met, which cannot begin; `missed`: such demands, "
    "on average. The last columns are CBAA without the bonus for what a lower bound needs."
)

BENCHMARK = Benchmark("one broadcast and an exact plan against an auction's rounds and bids", run)
