"""Hints for problems of a file's shape that are caused by its indentation."""

from __future__ import annotations

from collections.abc import Mapping

from pydantic_core import ErrorDetails

from mrbt_mesh.formats.problems import SourcePath


def indentation_hint(
    detail: ErrorDetails, place: SourcePath, lines: Mapping[SourcePath, int]
) -> str:
    """Return what to indent differently, as the end of a message; empty if that is not the cause.

    A key without a value may be followed by lines that belong to it, and a key that is missing may
    be indented one level too deep.
    """
    if detail["type"] == "missing":
        missing = str(detail["loc"][-1])
        deeper = [
            line
            for path, line in lines.items()
            if len(path) == len(place) + 2 and path[: len(place)] == place and path[-1] == missing
        ]
        return f"; line {deeper[0]} has it, indented too far" if deeper else ""
    if detail["input"] is not None or place not in lines:
        return ""
    following = min((line for line in lines.values() if line > lines[place]), default=0)
    beside = [path for path, line in lines.items() if line == following]
    if following and any(path[: len(place) - 1] == place[:-1] for path in beside):
        return f"; if line {following} belongs to it, indent that further"
    return ""
