"""Assignment problems from a file, for `mrbt assign`.

{"robots": {"r1": {"taskA": 3.0}},
 "demands": [{"id": "d1", "local_task": "taskA", "min": 1, "max": 2}],
 "constraints": {"never_together": [{"robots": ["r1", "r2"], "local_tasks": ["taskA"]}],
                 "at_most": [{"robots": ["r1", "r2"], "count": 1}],
                 "not_at_once": [{"demands": ["d1", "d2"], "count": 1}]}}

Without local_tasks `never_together` is about all demands; a count that is left out is 1.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any

from mrbt_mesh.core.assignment.problem import (
    AssignmentProblem,
    Bounds,
    Limit,
    Shared,
    SideConstraint,
)
from mrbt_mesh.core.mission.mission import MAX_PERFORMANCE, MICRO
from mrbt_mesh.errors import nearest, read_limited, whole_file_error

MAX_BYTES = 256 << 20


def problem_from_file(path: Path) -> AssignmentProblem:
    """The problem in a JSON file; raises FileError that says what would be right."""
    content = read_limited(path, MAX_BYTES)
    try:
        data = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise whole_file_error(str(path), f"is not JSON: {error}") from error
    if not isinstance(data, dict) or not isinstance(data.get("robots"), dict):
        raise whole_file_error(str(path), 'expected {"robots": {...}, "demands": [...]}')
    if not isinstance(data.get("demands"), list):
        raise whole_file_error(str(path), "demands: a list is expected")
    demands = [_demand(path, i, row) for i, row in enumerate(data["demands"])]
    ids = [bounds.id for bounds, _ in demands]
    for name, count in Counter(ids).items():
        if count > 1:
            raise whole_file_error(str(path), f"demand {name!r} appears {count} times")
    by_task: dict[str, list[int]] = {}
    for index, (_, local_task) in enumerate(demands):
        by_task.setdefault(local_task, []).append(index)
    robots = tuple(sorted(data["robots"]))
    performance = tuple(_performance(path, r, data["robots"][r], by_task) for r in robots)
    limits = _constraints(path, data.get("constraints", {}), robots, demands)
    return AssignmentProblem.of(robots, (b for b, _ in demands), performance, limits)


def _constraints(
    path: Path, data: Any, robots: Sequence[str], demands: Sequence[tuple[Bounds, str]]
) -> list[SideConstraint]:
    keys = {
        "never_together": ("robots", "local_tasks"),
        "at_most": ("robots", "count"),
        "not_at_once": ("demands", "count"),
    }
    if not isinstance(data, dict) or not data.keys() <= keys.keys():
        text = f"constraints: a map with {', '.join(keys)} is expected"
        raise whole_file_error(str(path), text)
    ids = [bounds.id for bounds, _ in demands]
    tasks = [local_task for _, local_task in demands]
    found: list[SideConstraint] = []
    for kind, rows in data.items():
        for number, row in enumerate(rows if isinstance(rows, list) else [rows]):
            where = f"constraints.{kind}[{number}]"
            if not isinstance(row, dict) or not {keys[kind][0]} <= row.keys() <= set(keys[kind]):
                text = f"{where}: a map with {' and '.join(keys[kind])} is expected"
                raise whole_file_error(str(path), text)
            count = row.get("count", 1)
            if not isinstance(count, int) or isinstance(count, bool) or count < 0:
                raise whole_file_error(str(path), f"{where}.count: a whole number is expected")
            if kind == "not_at_once":
                chosen = _numbers(path, f"{where}.demands", row["demands"], ids)
                found.append(Shared(tuple((d,) for d in chosen), count))
                continue
            who = _numbers(path, f"{where}.robots", row["robots"], robots)
            if kind == "at_most":
                found.append(Limit(who, tuple(range(len(ids))), count))
                continue
            named = row.get("local_tasks", tasks)
            _numbers(path, f"{where}.local_tasks", named, tasks)
            found += [Limit(who, (d,), 1) for d, task in enumerate(tasks) if task in named]
    return found


def _numbers(path: Path, where: str, names: Any, known: Sequence[str]) -> tuple[int, ...]:
    """Where the names stand among those that are known."""
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise whole_file_error(str(path), f"{where}: a list of names is expected")
    for name in names:
        if name not in known:
            raise whole_file_error(str(path), f"{where}: no {name!r} here{nearest(name, known)}")
    return tuple(sorted({known.index(name) for name in names}))


def _demand(path: Path, index: int, row: Any) -> tuple[Bounds, str]:
    where = f"demands[{index}]"
    if not isinstance(row, dict) or not {"id", "local_task", "min", "max"} <= set(row):
        raise whole_file_error(str(path), f"{where}: id, local_task, min and max are expected")
    if not isinstance(row["id"], str) or not isinstance(row["local_task"], str):
        raise whole_file_error(str(path), f"{where}: id and local_task are texts")
    low, high = row["min"], row["max"]
    if any(not isinstance(n, int) or isinstance(n, bool) for n in (low, high)):
        raise whole_file_error(str(path), f"{where}: min and max are whole numbers")
    if not 0 <= low <= high:
        raise whole_file_error(
            str(path), f"{where}: 0 <= min <= max is expected, found min {low}, max {high}"
        )
    return Bounds(row["id"], low, high), row["local_task"]


def _performance(
    path: Path, robot: str, table: Any, by_task: Mapping[str, list[int]]
) -> dict[int, int]:
    if not isinstance(table, dict):
        raise whole_file_error(
            str(path), f"robots.{robot}: a map of local task to performance is expected"
        )
    result = {}
    for local_task, value in table.items():
        where = f"robots.{robot}.{local_task}"
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise whole_file_error(
                str(path), f"{where}: a number is expected; leave out what it cannot do"
            )
        try:
            micro = int((Decimal(str(value)) * MICRO).to_integral_value())
        except (InvalidOperation, ValueError, OverflowError):
            raise whole_file_error(str(path), f"{where}: {value} is no finite number") from None
        if abs(micro) > MAX_PERFORMANCE:
            raise whole_file_error(
                str(path), f"{where}: {value} is out of range (at most 1e6 either way)"
            )
        for index in by_task.get(local_task, ()):
            result[index] = micro
    return result
