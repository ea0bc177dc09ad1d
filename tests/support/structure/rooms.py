"""What the kernel knows of features, and what a plain robot loads: figures that may only fall."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator, Mapping
from pathlib import Path

from mrbt_mesh.core.feature import NAMES
from tests.support.structure.source import files, parsed

# The words that name a feature in the kernel, and those of its files that are still among it.
WORDS: Mapping[str, str] = {
    "bids": r"bid|bids|bidder|biddings?|by_bid",
    "constraints": r"constraints?|side_constraints",
    "contact": r"contact|lost_contact|borrow\w*|loans?|attend",
    "exclusive": r"exclusive|leases?|leased|grants?|grantors?|coalitions?|simultaneous|in_doubt",
    "jobs": r"jobs?|job_\w+|\w+_jobs?",
    "keys": r"keys|sealing|envelope|revoked|signed",
    "large_teams": r"ring|newcomers|plan_only",
    "revisions": r"revisions?|revised|reviser|revision_\w+|is_revised|declared",
    "travel": r"travel\w*|places?|schedul\w+|ways?|overtak\w+|proposals?|ahead",
    "values": r"blackboard|per_robot|own_conditions|has_own_\w+|holds_value|entry_\w+",
}
OWN_FILES: Mapping[str, str] = {
    "bids": r"nothing",
    "constraints": r"nothing",
    "contact": r"nothing",
    "exclusive": r"nothing",
    "jobs": r"jobs?|job_\w+|jobs_on_disk",
    "keys": r"keys|envelope|sealing|signed_reports",
    "large_teams": r"ring",
    "revisions": r"nothing",
    "travel": r"travel|scheduler|schedules|ahead|forecast|order|problem|dispatch|search|task_order",
    "values": r"nothing",
}
# The one table of the kernel that lists features.
TABLE = "feature.py"
_ASKS = re.compile(r"\b(?:if|elif|while|and|or|case|not)\b|\bis None\b")
# Where one robot's process begins, and what it imports by name in any mission.
AGENT = (
    *("mrbt_mesh.cli.commands.agent", "mrbt_mesh.runtime.robot_process"),
    *(f"mrbt_mesh.features.{name}" for name in NAMES),
)


def code_lines(path: Path) -> Iterator[str]:
    """The lines of a module without comments, docstrings, blank lines and imports."""
    text = path.read_text(encoding="utf-8")
    left_out: set[int] = set()
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import | ast.ImportFrom) or _is_text(node):
            assert isinstance(node, ast.stmt)
            left_out.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    lines = text.splitlines()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            row, column = token.start
            lines[row - 1] = lines[row - 1][:column]
    for number, line in enumerate(lines, 1):
        if number not in left_out and line.strip():
            yield line


def _is_text(node: ast.AST) -> bool:
    """Whether this is a docstring, or another text that is a statement of its own."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def naming(kernel: Path) -> dict[str, tuple[int, int]]:
    """Feature -> how many lines of the kernel name it, and how many of these ask for something.

    Its own files are not counted, as they are the room that it has yet to leave the kernel for.
    """
    lines = {
        path: list(code_lines(path)) for path in files(kernel, ".py", ".") if path.name != TABLE
    }
    found = {}
    for feature, words in WORDS.items():
        own, name = re.compile(OWN_FILES[feature]), re.compile(rf"(?<![a-z])(?:{words})(?![a-z])")
        named = [
            line
            for path, known in lines.items()
            if not own.fullmatch(path.stem)
            for line in known
            if name.search(line)
        ]
        found[feature] = len(named), sum(_ASKS.search(line) is not None for line in named)
    return found


def loaded_lines(root: Path) -> int:
    """The lines of code in the modules that a robot's process imports before it begins, as far as
    imports stand at the top of modules. Docstrings, comments and imports do not count.
    """
    seen: set[str] = set()
    waiting = list(AGENT)
    lines = 0
    while waiting:
        name = waiting.pop()
        path = _path(root, name)
        if name in seen or path is None:
            continue
        seen.add(name)
        lines += sum(1 for _ in code_lines(path))
        waiting += name.rpartition(".")[:1]
        for node in parsed(path).body:
            match node:
                case ast.Import(names):
                    waiting += [each.name for each in names]
                case ast.ImportFrom(str(module), names, 0):
                    waiting += [module, *(f"{module}.{each.name}" for each in names)]
    return lines


def _path(root: Path, module: str) -> Path | None:
    """The file of a module of the package, if it is one."""
    path = root.joinpath(*module.split("."))
    found = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    return found if module.startswith("mrbt_mesh") and found.is_file() else None
