"""`mrbt tree check` at work: a BehaviorTree.CPP file, or a mission."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mrbt_mesh.cli.framework.exits import BAD_INPUT
from mrbt_mesh.cli.framework.terminal import console, errors, labelled, print_json
from mrbt_mesh.cli.trees.files import read_tree_file
from mrbt_mesh.cli.views.finding_view import check_lines, line
from mrbt_mesh.errors import InputError
from mrbt_mesh.formats.btcpp.document import Category
from mrbt_mesh.formats.btcpp.findings import Finding, Findings, Severity
from mrbt_mesh.formats.btcpp.library import Library
from mrbt_mesh.formats.btcpp.team_tree import to_team_tree
from mrbt_mesh.formats.btcpp.xml_reader import TreeFileError
from mrbt_mesh.formats.mission_file import load_mission, mission_warnings
from mrbt_mesh.formats.problems import Problem


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
    def counts(self) -> dict[str, int]:
        trees = self.library.trees
        return {
            "files": len(self.library.documents),
            "trees": len(trees),
            "nodes": sum(len(list(tree.element.walk())) - 1 for tree in trees.values()),
        }


def check_tree_file(
    file: Path, strict: bool, team: bool, assume_actions: bool, as_json: bool
) -> None:
    """Print what is wrong with a file; exit status 2 if anything is.

    Raises InputError for a file that cannot be read at all, but as JSON says also that.
    """
    try:
        library, findings = read_tree_file(file, strict)
    except TreeFileError as error:
        if not as_json:
            raise
        _print_unreadable(file, error)
        raise SystemExit(BAD_INPUT) from None
    checked = _Checked(library, findings, _team(file, library, findings, assume_actions, team))
    is_valid = not findings.errors and not checked.refusals
    if as_json:
        _print_json(file, checked, is_valid)
    else:
        for text in check_lines(findings, checked.refusals, checked.notes):
            errors.print(text, soft_wrap=True)
        if is_valid:
            counts = checked.counts.items()
            listed = ", ".join(f"{n} {name if n != 1 else name[:-1]}" for name, n in counts)
            console.print(line("valid", "bold green", f"{file}: {listed}"), soft_wrap=True)
    if not is_valid:
        raise SystemExit(BAD_INPUT)


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


def _print_json(file: Path, checked: _Checked, is_valid: bool) -> None:
    data: dict[str, Any] = {"file": str(file), "valid": is_valid, **checked.counts}
    data["findings"] = [finding.to_json() for finding in checked.findings.in_order()]
    if checked.for_a_team is not None:
        data["refusals"] = [_reason_json(problem) for problem in checked.refusals]
        data["notes"] = [_reason_json(problem) for problem in checked.notes]
    print_json(data)


def _print_unreadable(file: Path, error: TreeFileError) -> None:
    found = [Finding(Severity.ERROR, problem).to_json() for problem in error.problems]
    data = {"file": str(file), "valid": False, "files": 0, "trees": 0, "nodes": 0}
    print_json({**data, "findings": found})


def _reason_json(problem: Problem) -> dict[str, str | int]:
    return {
        "file": problem.file,
        "line": problem.line,
        "path": problem.path,
        "reason": problem.message,
    }


def check_mission(file: Path, as_json: bool) -> None:
    """Print what a mission's file warns of; raises MissionError if it cannot be used."""
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
