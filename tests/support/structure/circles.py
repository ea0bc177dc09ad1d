"""Circles of imports: each module must be readable without those that are read because of it."""

from __future__ import annotations

import ast
from collections import deque
from collections.abc import Iterator, Mapping
from pathlib import Path

from tests.support.structure.source import Finding, modules, parsed

Graph = Mapping[str, frozenset[str]]


def imports(root: Path, package: str) -> Graph:
    """Which modules of a package each of them names in an import, wherever that stands.

    In functions and under TYPE_CHECKING, too. That a module imports the packages around it is
    not counted: only what it names.
    """
    known = modules(root, package)
    return {
        name: frozenset(target for target in _named(path, name, known) if target != name)
        for name, path in known.items()
    }


def _named(path: Path, name: str, known: Mapping[str, Path]) -> Iterator[str]:
    around = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif isinstance(node, ast.ImportFrom):
            above = around[: len(around) - node.level + 1] if node.level else []
            source = ".".join([*above, *([node.module] if node.module else [])])
            for alias in node.names:
                full = f"{source}.{alias.name}"
                if full in known or source in known:
                    yield full if full in known else source


def circles(root: Path, package: str) -> list[Finding]:
    """The shortest circle through each module that is on one, each circle once."""
    graph = imports(root, package)
    found = {}
    for name in sorted(graph):
        circle = _shortest(graph, name)
        if circle:
            first = circle.index(min(circle))
            turned = [*circle[first:], *circle[:first]]
            way = " imports ".join([*turned, turned[0]])
            found[frozenset(circle)] = Finding(way, "a circle of imports")
    return sorted(found.values())


def _shortest(graph: Graph, start: str) -> list[str]:
    """The modules on a shortest way from a module back to itself; none: empty."""
    before: dict[str, str] = {}
    waiting = deque([start])
    while waiting:
        here = waiting.popleft()
        for target in sorted(graph[here]):
            if target == start:
                way = [here]
                while way[-1] != start:
                    way.append(before[way[-1]])
                return way[::-1]
            if target not in before:
                before[target] = here
                waiting.append(target)
    return []
