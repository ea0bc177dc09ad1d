"""Implements `mrbt tree check`: a BehaviorTree.CPP file, a folder of them, or a mission."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mrbt_mesh.analysis.team_tree import to_team_tree
from mrbt_mesh.btcpp.files.check import check_file
from mrbt_mesh.btcpp.files.document import Category
from mrbt_mesh.btcpp.files.findings import Finding, Severity
from mrbt_mesh.btcpp.files.folder import read_folder
from mrbt_mesh.btcpp.files.library import Library, together
from mrbt_mesh.cli.command import BAD_INPUT
from mrbt_mesh.cli.terminal import console, errors, labelled, print_done, print_json
from mrbt_mesh.errors import FileError, Problem
from mrbt_mesh.formats.mission_file import load_mission, mission_warnings

STYLES = {"error": "bold red", "warning": "yellow", "not for a team": "bold red", "note": "cyan"}


@dataclass(frozen=True)
class TreeCheck:
    """How thoroughly files are checked: the options of `mrbt tree check`."""

    strict: bool
    team: bool
    assume_actions: bool
    as_json: bool

    def file(self, file: Path) -> None:
        """Print the problems of a file; exit with status 2 if it has errors.

        Raises InputError for a file that cannot be read at all; with JSON, that is printed as well.
        """
        try:
            data = self._checked(file, None)
        except FileError as error:
            if not self.as_json:
                raise
            data = _unreadable(file, error)
        if self.as_json:
            print_json(data)
        if not data["valid"]:
            raise SystemExit(BAD_INPUT)

    def folder(self, folder: Path) -> None:
        """Print the problems of the files of a folder, which know each other's trees and models.

        Exits with status 2 if any has errors. Raises InputError for a folder without such files.
        """
        found = read_folder(folder)
        known = together(found.documents.values())
        everything: list[dict[str, Any]] = []
        for path in sorted({*found.documents, *found.unreadable}):
            try:
                everything.append(self._checked(path, known))
            except FileError as error:
                everything.append(_unreadable(path, error))
                if not self.as_json:
                    print_finding("error", error)
        valid, count = sum(data["valid"] for data in everything), len(everything)
        if self.as_json:
            skipped = [str(path) for path in found.skipped]
            data = {"folder": str(folder), "valid": valid == count, "skipped": skipped}
            print_json({**data, "files": everything})
        else:
            text = f"{valid} of {count} file{'s' if count > 1 else ''} in {folder}"
            if found.skipped:
                text += f"; skipped, since they hold no trees: {len(found.skipped)} others"
            console.print(labelled("valid", "bold green" if valid == count else "bold red", text))
        if valid < count:
            raise SystemExit(BAD_INPUT)

    def _checked(self, file: Path, others: Library | None) -> dict[str, Any]:
        """Return the result as data; without `as_json`, it is also printed. Raises FileError."""
        library, findings = check_file(file, self.strict, others=others)
        refusals: tuple[Problem, ...] = ()
        notes: tuple[Problem, ...] = ()
        # Many files of a folder only hold trees for others.
        is_part = others is not None and library.main_tree is None
        if self.team and not findings.errors and not is_part:
            leaves = Category.ACTION if self.assume_actions else None
            for_a_team = to_team_tree(library, library.chosen_tree(), leaves)
            refusals, notes = for_a_team.refusals, for_a_team.notes
        trees = library.own_trees.values()
        counts = {
            "files": len(library.documents),
            "trees": len(trees),
            "nodes": sum(len(list(tree.element.walk())) - 1 for tree in trees),
        }
        valid = not findings.errors and not refusals
        data: dict[str, Any] = {"file": str(file), "valid": valid, **counts}
        data["findings"] = [finding.to_json() for finding in findings.in_order()]
        if self.team:
            data |= {"refusals": _reasons(refusals), "notes": _reasons(notes)}
        if self.as_json:
            return data
        for finding in findings.in_order():
            print_finding(finding.severity, finding)
        if findings.is_full:
            print_finding("error", "and more")
        for label, problems in (("not for a team", refusals), ("note", notes)):
            for problem in problems:
                print_finding(label, problem)
        if valid:
            listed = ", ".join(f"{n} {name if n != 1 else name[:-1]}" for name, n in counts.items())
            print_done("valid", f"{file}: {listed}")
        return data


def print_finding(label: str, what: object) -> None:
    """Print an error, a warning or a note on stderr."""
    errors.print(labelled(label, STYLES[label], str(what)), soft_wrap=True)


def _unreadable(file: Path, error: FileError) -> dict[str, Any]:
    found = [Finding(Severity.ERROR, problem).to_json() for problem in error.problems]
    data = {"file": str(file), "valid": False, "files": 0, "trees": 0, "nodes": 0}
    return {**data, "findings": found}


def _reasons(problems: Iterable[Problem]) -> list[dict[str, str | int]]:
    return [
        {"file": each.file, "line": each.line, "path": each.path, "reason": each.message}
        for each in problems
    ]


def check_mission(file: Path, as_json: bool) -> None:
    """Print the warnings of a mission file. Raises FileError if it cannot be used."""
    mission = load_mission(file)
    warnings = mission_warnings(mission)
    if as_json:
        found = [
            Finding(Severity.WARNING, Problem(str(file), 0, "", text)).to_json()
            for text in warnings
        ]
        data = {"file": str(file), "valid": True, "files": 1, "trees": 1}
        print_json({**data, "nodes": len(mission.tree.nodes), "findings": found})
        return
    for text in warnings:
        print_finding("warning", text)
    print_done("valid", f"{file}: a mission, {len(mission.tree.nodes)} nodes")
