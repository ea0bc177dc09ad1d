"""`mrbt tree check` at work: a BehaviorTree.CPP file, a folder of them, or a mission."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mrbt_mesh.analysis.team_tree import to_team_tree
from mrbt_mesh.btcpp.files.document import Category
from mrbt_mesh.btcpp.files.findings import Finding, Findings, Severity
from mrbt_mesh.btcpp.files.folder import read_folder
from mrbt_mesh.btcpp.files.library import Library, together
from mrbt_mesh.cli.command import BAD_INPUT
from mrbt_mesh.cli.terminal import console, errors, labelled, print_json
from mrbt_mesh.cli.trees.files import read_tree_file
from mrbt_mesh.cli.views.finding_view import check_lines, line
from mrbt_mesh.errors import FileError, InputError, Problem
from mrbt_mesh.formats.mission_file import load_mission, mission_warnings


@dataclass(frozen=True)
class _Checked:
    """A file with what is wrong with it; None: what a team makes of it was not asked."""

    library: Library
    findings: Findings
    for_a_team: tuple[tuple[Problem, ...], tuple[Problem, ...]] | None

    @property
    def refusals(self) -> tuple[Problem, ...]:
        return self.for_a_team[0] if self.for_a_team else ()

    @property
    def notes(self) -> tuple[Problem, ...]:
        return self.for_a_team[1] if self.for_a_team else ()

    @property
    def is_valid(self) -> bool:
        return not self.findings.errors and not self.refusals

    @property
    def counts(self) -> dict[str, int]:
        trees = self.library.own_trees
        return {
            "files": len(self.library.documents),
            "trees": len(trees),
            "nodes": sum(len(list(tree.element.walk())) - 1 for tree in trees.values()),
        }


@dataclass(frozen=True)
class Asked:
    """How thoroughly files are checked: the options of `mrbt tree check`."""

    strict: bool
    team: bool
    assume_actions: bool
    as_json: bool


def check_tree_file(file: Path, asked: Asked) -> None:
    """Print what is wrong with a file; exit status 2 if anything is.

    Raises InputError for a file that cannot be read at all, but as JSON says also that.
    """
    try:
        checked = _checked(file, asked, None)
    except FileError as error:
        if not asked.as_json:
            raise
        print_json(_unreadable_json(file, error))
        raise SystemExit(BAD_INPUT) from None
    if asked.as_json:
        print_json(_json(file, checked))
    else:
        _print(file, checked)
    if not checked.is_valid:
        raise SystemExit(BAD_INPUT)


def check_tree_folder(folder: Path, asked: Asked) -> None:
    """Print what is wrong with the files of a folder, which know each other's trees and models.

    Exit status 2 if any has errors. Raises InputError for a folder without such files.
    """
    found = read_folder(folder)
    known = together(found.documents.values())
    everything: list[dict[str, Any]] = []
    valid = 0
    for path in sorted({*found.documents, *found.unreadable}):
        try:
            checked = _checked(path, asked, known)
        except FileError as error:
            everything.append(_unreadable_json(path, error))
            if not asked.as_json:
                errors.print(line("error:", "bold red", str(error)), soft_wrap=True)
            continue
        valid += checked.is_valid
        everything.append(_json(path, checked))
        if not asked.as_json:
            _print(path, checked)
    count = len(everything)
    if asked.as_json:
        skipped = [str(path) for path in found.skipped]
        data = {"folder": str(folder), "valid": valid == count, "skipped": skipped}
        print_json({**data, "files": everything})
    else:
        text = f"{valid} of {count} file{'s' if count > 1 else ''} in {folder}"
        if found.skipped:
            text += f"; skipped, since they hold no trees: {len(found.skipped)} others"
        console.print(line("valid:", "bold green" if valid == count else "bold red", text))
    if valid < count:
        raise SystemExit(BAD_INPUT)


def _checked(file: Path, asked: Asked, others: Library | None) -> _Checked:
    library, findings = read_tree_file(file, asked.strict, others)
    if asked.team and others is not None and library.main_tree is None:
        # Of a folder's files, many only hold trees for others.
        return _Checked(library, findings, ((), ()))
    for_a_team = _team(file, library, findings, asked.assume_actions, asked.team)
    return _Checked(library, findings, for_a_team)


def _print(file: Path, checked: _Checked) -> None:
    for text in check_lines(checked.findings, checked.refusals, checked.notes):
        errors.print(text, soft_wrap=True)
    if checked.is_valid:
        counts = checked.counts.items()
        listed = ", ".join(f"{n} {name if n != 1 else name[:-1]}" for name, n in counts)
        console.print(line("valid", "bold green", f"{file}: {listed}"), soft_wrap=True)


def _team(
    file: Path, library: Library, findings: Findings, assume_actions: bool, wanted: bool
) -> tuple[tuple[Problem, ...], tuple[Problem, ...]] | None:
    """(what a team cannot carry out, what it does otherwise) if that is asked."""
    if not wanted:
        return None
    if findings.errors:
        return (), ()
    if library.main_tree is None:
        raise InputError(f"{file}: main_tree_to_execute has to name a tree")
    leaves = Category.ACTION if assume_actions else None
    found = to_team_tree(library, library.main_tree, leaves)
    return found.refusals, found.notes


def _json(file: Path, checked: _Checked) -> dict[str, Any]:
    data: dict[str, Any] = {"file": str(file), "valid": checked.is_valid, **checked.counts}
    data["findings"] = [finding.to_json() for finding in checked.findings.in_order()]
    if checked.for_a_team is not None:
        data["refusals"] = [_reason_json(problem) for problem in checked.refusals]
        data["notes"] = [_reason_json(problem) for problem in checked.notes]
    return data


def _unreadable_json(file: Path, error: FileError) -> dict[str, Any]:
    found = [Finding(Severity.ERROR, problem).to_json() for problem in error.problems]
    data = {"file": str(file), "valid": False, "files": 0, "trees": 0, "nodes": 0}
    return {**data, "findings": found}


def _reason_json(problem: Problem) -> dict[str, str | int]:
    return {
        "file": problem.file,
        "line": problem.line,
        "path": problem.path,
        "reason": problem.message,
    }


def check_mission(file: Path, as_json: bool) -> None:
    """Print what a mission's file warns of; raises FileError if it cannot be used."""
    mission = load_mission(file)
    warnings = mission_warnings(mission)
    nodes = len(mission.tree.nodes)
    if as_json:
        found = [
            {"severity": "warning", "file": str(file), "line": 0, "path": "", "message": text}
            for text in warnings
        ]
        data = {"file": str(file), "valid": True, "files": 1, "trees": 1, "nodes": nodes}
        print_json({**data, "findings": found})
        return
    for text in warnings:
        errors.print(labelled("warning", "yellow", text), soft_wrap=True)
    text = f"{file}: a mission, {nodes} nodes"
    console.print(line("valid", "bold green", text), soft_wrap=True)
