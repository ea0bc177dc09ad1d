"""All results as plain data, and as tables."""

from __future__ import annotations

import statistics
from typing import Any

from benchmarks.membership.agreement import Drill
from benchmarks.membership.declarations import Declarations
from benchmarks.membership.jobs import Key
from benchmarks.membership.networks import BROKEN, GRADED, ROUGH, SECOND_US
from benchmarks.report import grid


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


def summary(found: dict[Key, list[Any]]) -> dict[str, list[dict[str, Any]]]:
    """Everything as plain data."""
    tables: dict[str, list[dict[str, Any]]] = {"declarations": [], "agreement": [], "traffic": []}
    order = {net: index for index, net in enumerate([*GRADED, *BROKEN, ROUGH])}
    for kind, robots, net in sorted(found, key=lambda key: (key[0], key[1], order[key[2]])):
        results = found[kind, robots, net]
        row: dict[str, Any] = {"robots": robots, "network": str(net)}
        if kind == "declarations":
            total = Declarations()
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


def median_p99(spread: dict[str, float]) -> str:
    return f"{spread['median_s']:.2f} / {spread['p99_s']:.2f}"


def _setting(row: dict[str, Any]) -> tuple[Any, Any]:
    return row["robots"], row["network"]


def markdown(tables: dict[str, list[dict[str, Any]]]) -> str:
    """All tables, for people."""
    head = ["robots", "network", "minutes", "false", "plain", "found after, s", "plain, s"]
    teams: list[list[Any]] = []
    pairs: list[list[Any]] = []
    for row in tables["declarations"]:
        counts = f"{row['minutes']:g}", row["false"], row["plain_false"]
        times = [median_p99(row[kind]) for kind in ("detection", "plain_detection")]
        (teams if row["robots"] > 2 else pairs).append([*_setting(row), *counts, *times])
    kinds = [*sorted(set(Drill.KINDS)), "all"]
    agreed = [
        [*_setting(row), *(median_p99(row[kind]) if kind in row else "-" for kind in kinds)]
        for row in tables["agreement"]
    ]
    columns = ("rest_messages", "rest_kb", "event_messages", "event_kb")
    sent = [[*_setting(row), *(row[name] for name in columns)] for row in tables["traffic"]]
    return "\n\n".join(
        [
            "**Declarations.** `minutes` of a team at rest, `false` declarations of death in them "
            "(beside it those of the plain detector), and the time from a freeze until a robot "
            "has found it (median / 99th percentile).",
            grid(head, teams),
            "**Two robots**, where nobody else can be asked:",
            grid(head, pairs),
            "**Agreement.** Seconds from an event (a death: from the first declaration; a join: "
            "from the start of the process) until every living robot may start without its grace "
            "(median / 99th percentile).",
            grid(["robots", "network", *kinds], agreed),
            "**Traffic.** Copies sent per robot and second, and kB, at rest and in the second "
            "after an outcome.",
            grid(["robots", "network", "rest", "kB", "event", "kB"], sent),
        ]
    )
