"""The paper's two tables and its tree, from the mission file.

What is the same for every part is written once, for a part k.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby

from mrbt_mesh.core.bt.tree import Kind, NodeSpec, build_tree
from mrbt_mesh.core.mission.mission import MICRO, Mission
from mrbt_mesh.core.mission.names import split_call, type_name

MINUS_INFINITY = "−∞"


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    """A Markdown table; the first column is text, the others are centred."""
    lines = [_row(head), _row(["---", *[":-:"] * (len(head) - 1)])]
    return lines + [_row([str(cell) for cell in row]) for row in rows]


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def for_part_k(mission: Mission, ground: str) -> str:
    """`fix_hw(2)` -> `fix_hw(k)`, where 2 is a part."""
    name, arguments = split_call(ground)
    parts = set(map(str, mission.parameters["parts"]))
    shown = ["k" if argument in parts else argument for argument in arguments]
    return f"{name}({','.join(shown)})" if shown else name


def performances(mission: Mission) -> list[tuple[str, ...]]:
    """Local task, then p(i, l) of each type of robot; minus infinity where it cannot do it."""
    rows = []
    for name in dict.fromkeys(local_task for _, local_task, _, _ in bounds(mission)):
        values = (able.get(type_name(name)) for able in mission.robot_types.values())
        shown = (MINUS_INFINITY if v is None else f"{v / MICRO:g}" for v in values)
        rows.append((name, *shown))
    return rows


def bounds(mission: Mission) -> list[tuple[str, str, int, int]]:
    """Global task, local task, nu, mu, in the file's order."""
    rows = {
        (
            for_part_k(mission, task.id),
            for_part_k(mission, need.local_task),
            need.min_robots,
            need.max_robots,
        ): None
        for task in mission.global_tasks.values()
        for need in task.needs
    }
    return list(rows)


def tree_lines(mission: Mission) -> list[str]:
    """T_G as indented text, conditions with a question mark.

    Neighbours that differ in their part alone are shown once.
    """

    def name(spec: NodeSpec) -> str:
        if spec.kind is Kind.SUBTREE:
            return for_part_k(mission, spec.name)
        if spec.subject:
            return for_part_k(mission, spec.subject) + "?" * (spec.kind is Kind.CONDITION)
        return build_tree(spec).nodes[0].label

    def show(spec: NodeSpec) -> list[str]:
        lines = [name(spec)]
        groups = [
            (child, len(list(same)))
            for child, same in groupby(show(child) for child in spec.children)
        ]
        for number, ((first, *others), count) in enumerate(groups, 1):
            mark = f"   for k = {_range(mission)}" if count > 1 else ""
            turn, bar = ("└─ ", "   ") if number == len(groups) else ("├─ ", "│  ")
            lines.append(turn + first + mark)
            lines += [bar + line for line in others]
        return lines

    return show(mission.tree.spec())


def _range(mission: Mission) -> str:
    parts = mission.parameters["parts"]
    return f"{parts[0]} … {parts[-1]}"
