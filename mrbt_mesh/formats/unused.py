"""Find declarations of a mission file that nothing in it uses: often a misspelt name.

A name counts as used wherever a text of another part contains it, so that warnings are few and
certain. Programs may use parameters of the mission, conditions and entries, too: these count as
used if a Python file in the program's folder has the word. Without such a file there are no
warnings about them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from mrbt_mesh.formats.problems import Report
from mrbt_mesh.formats.tree_model import ALL_TYPES
from mrbt_mesh.formats.yaml_source import read_mapping

# The section, what its entries are called, and the parts of the file that may use them.
_DECLARED = (
    ("local_tasks", "local task", ("global_tasks", "jobs", "constraints")),
    ("global_tasks", "global task", ("global_tasks", "tree", "subtrees", "jobs", "constraints")),
    ("conditions", "condition", ("global_tasks", "local_tasks", "tree", "subtrees", "jobs")),
    ("blackboard", "entry", ("global_tasks", "local_tasks", "tree", "subtrees", "jobs")),
    ("robot_types", "robot type", ("robots",)),
    ("subtrees", "subtree", ("tree", "subtrees", "jobs")),
    ("jobs", "type of jobs", ("tree", "subtrees")),
)
_FOR_PROGRAMS = frozenset({"conditions", "blackboard"})
# Parameters that views read.
_FOR_VIEWS = frozenset({"map"})
MAX_PROGRAM_FILES = 100
MAX_PROGRAM_BYTES = 1 << 20
# Parts whose entries have their own parameters, which their bodies name.
_WITH_PARAMETERS = ("global_tasks", "subtrees", "jobs")
_WORD = re.compile(r"[\w$-]+")
_REFERENCE = re.compile(r"\$\{?([\w-]+)")


def unused_declarations(mission: Path, program: str | None) -> list[str]:
    """Return warnings with line and remedy, in the order of the file.

    There are none for a compiled mission. `program` is the path of the robots' program, with its
    `:name` if it has one.
    """
    if mission.suffix.lower() == ".json":
        return []
    data, report = read_mapping(mission, "a mission is expected")
    words = _program_words(program)
    found = list(_unused_names(data, report, words))
    if words is not None:
        found += _unused_mission_parameters(data, report, words)
    found += _unused_parameters(data, report)
    return [f"line {line}: {text}" for line, text in sorted(found)]


def _program_words(program: str | None) -> frozenset[str] | None:
    """Return the words of the Python files beside the program; None if it is not a file."""
    file = Path((program or "").partition(".py")[0] + ".py")
    if not file.is_file():
        return None
    words: set[str] = set()
    for path in sorted(file.parent.glob("*.py"))[:MAX_PROGRAM_FILES]:
        try:
            with path.open("rb") as stream:
                text = stream.read(MAX_PROGRAM_BYTES).decode(errors="replace")
        except OSError:
            continue
        words |= set(re.findall(r"\w+", text))
    return frozenset(words)


def _unused_names(
    data: Mapping[str, Any], report: Report, words: frozenset[str] | None
) -> Iterator[tuple[int, str]]:
    for part, what, users in _DECLARED:
        is_known_whole = part not in _FOR_PROGRAMS or words is not None
        # A Jobs node that names no types has all of them.
        if not is_known_whole or (part == "jobs" and _has_all_jobs(data)):
            continue
        for name in _keys(data.get(part)):
            others = (
                text for user in (*users, "parameters") for text in _used_in(data, user, part, name)
            )
            is_in_program = part in _FOR_PROGRAMS and name in (words or ())
            if not is_in_program and not _names(others, name):
                text = f"the {what} {name!r} is declared and nothing uses it"
                yield report.line((part, name)), f"{text}; remove it, or correct a name"


def _used_in(data: Mapping[str, Any], user: str, part: str, name: str) -> Iterator[str]:
    """Yield the texts of a part that may use a name.

    In the part that declares the name, these are the texts of the other entries.
    """
    if user != part:
        yield from _texts(data.get(user))
        return
    for other, body in _items(data.get(part)):
        if other != name:
            yield from _texts(body)


def _unused_mission_parameters(
    data: Mapping[str, Any], report: Report, words: frozenset[str]
) -> Iterator[tuple[int, str]]:
    used = {*_references(data), *words, *_FOR_VIEWS}
    for name in _keys(data.get("parameters")):
        if name not in used:
            text = f"the parameter {name!r} is declared and nothing uses it"
            yield report.line(("parameters", name)), f"{text}; remove it, or write ${name}"


def _unused_parameters(data: Mapping[str, Any], report: Report) -> Iterator[tuple[int, str]]:
    for part in _WITH_PARAMETERS:
        for owner, entry in _items(data.get(part)):
            body = {k: v for k, v in _items(entry) if k != "parameters"}
            used = set(_references(body))
            parameters = entry.get("parameters") if isinstance(entry, Mapping) else None
            for name in parameters if isinstance(parameters, Iterable) else ():
                if str(name) not in used:
                    text = f"the parameter {name!r} of {owner!r} is declared and nothing uses it"
                    line = report.line((part, owner, "parameters"))
                    yield line, f"{text}; remove it, or write ${name}"


def _keys(value: Any) -> list[str]:
    return [str(key) for key in value] if isinstance(value, Mapping) else []


def _items(value: Any) -> list[tuple[str, Any]]:
    return list(value.items()) if isinstance(value, Mapping) else []


def _has_all_jobs(value: Any) -> bool:
    """True if some Jobs node does not name types."""
    if isinstance(value, str):
        return value == "Jobs"
    if isinstance(value, list):
        return any(map(_has_all_jobs, value))
    return any(
        (key == "Jobs" and _means_all_jobs(inner)) or _has_all_jobs(inner)
        for key, inner in _items(value)
    )


def _means_all_jobs(body: Any) -> bool:
    types = body.get("types") if isinstance(body, Mapping) else body
    return types in (None, ALL_TYPES)


def _texts(value: Any) -> Iterator[str]:
    """Yield all keys and texts inside a value."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for key, inner in value.items():
            yield str(key)
            yield from _texts(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _texts(inner)


def _references(value: Any) -> Iterator[str]:
    for text in _texts(value):
        yield from _REFERENCE.findall(text)


def _names(texts: Iterable[str], name: str) -> bool:
    """True if a word of the texts is the name, or may become it once parameters are filled in."""
    for text in texts:
        for word in _WORD.findall(text):
            if word == name:
                return True
            fixed, *rest = _REFERENCE.split(word)[::2]
            pattern = ".*".join(map(re.escape, (fixed, *rest)))
            if rest and pattern != ".*" and re.fullmatch(pattern, name):
                return True
    return False
