"""Writes trees as BehaviorTree.CPP 4 XML."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mrbt_mesh.analysis.team_tree_writer import team_tree_document
from mrbt_mesh.btcpp.files.check import check_library
from mrbt_mesh.btcpp.files.document import Document
from mrbt_mesh.btcpp.files.export import explicit, with_ids
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.files.folder import read_folder
from mrbt_mesh.btcpp.files.library import Library, load_library, together
from mrbt_mesh.btcpp.files.loadable import compact, loadable
from mrbt_mesh.cli.command import BAD_INPUT
from mrbt_mesh.cli.terminal import errors, labelled, print_done, reason, write_file
from mrbt_mesh.core.bt.tree import Kind
from mrbt_mesh.errors import FileError, InputError
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.views.trees.checking import print_finding
from mrbt_mesh.views.trees.shapes import is_mission


@dataclass(frozen=True)
class Wanted:
    """How trees are written: the options of `mrbt tree convert`."""

    is_compact: bool = False
    is_merged: bool = False
    has_ids: bool = False


def convert_file(source: Path, target: Path, wanted: Wanted, others: Library | None = None) -> None:
    """Write one file. Raises InputError for a file with errors.

    Its oddities are printed, and what BehaviorTree.CPP still refuses.
    """
    if target.suffix.lower() != ".xml":
        raise InputError(f"{target}: the file to write has to end in .xml")
    found = Findings()
    if is_mission(source):
        if wanted.has_ids or wanted.is_merged:
            raise InputError("--ids and --merge are for BehaviorTree.CPP files")
        tree = load_mission(source).tree.spec()
        if tree.contains(Kind.JOBS):
            message = "BehaviorTree.CPP has no node for jobs; convert a mission without Jobs nodes"
            raise InputError(f"{source}: {message}")
        library = Library()
        library.add(team_tree_document(tree, str(source)))
        document = explicit(library)
    else:
        checked = Findings()
        library = load_library(source, found, others=others)
        check_library(library, checked)
        for findings in (found, checked):
            findings.raise_errors()
        merge = wanted.is_merged
        document = with_ids(library) if wanted.has_ids else explicit(library, is_merged=merge)
    document = loadable(compact(document) if wanted.is_compact else document)
    left = Findings()
    check_library(_as_written(document, library, wanted), left)
    for finding in {**found.found, **left.found}:
        print_finding(finding.severity, finding)
    write_file(target, document.text())
    trees = len(document.trees)
    print_done("written", f"{target}: {trees} tree{'s' if trees > 1 else ''}")


def _as_written(document: Document, library: Library, wanted: Wanted) -> Library:
    """Return the document as it will be read again, with the files that it includes."""
    written = Library()
    written.documents.append(document)
    for included in library.documents[1:] if document.includes else ():
        written.add(included)
    written.register(document)
    if not wanted.has_ids:
        written.know(library)
    written.missing_files = library.missing_files
    return written


def convert_folder(source: Path, target: Path, wanted: Wanted) -> None:
    """Write all BehaviorTree.CPP files of a folder to another one, under the same names.

    Exits with status 2 if a file has errors, after the others are written.
    """
    if wanted.is_merged or wanted.has_ids:
        raise InputError("--ids and --merge are for one file")
    if target.exists() and not target.is_dir():
        raise InputError(f"{target}: is not a folder, but {source} is one")
    if source.resolve() in (target.resolve(), *target.resolve().parents):
        raise InputError(f"{target}: has to lie outside of {source}, which would be read again")
    folder = read_folder(source)
    known = together(folder.documents.values())
    failed = list(folder.unreadable.values())
    for path in folder.documents:
        to = target / path.relative_to(source)
        try:
            to.parent.mkdir(parents=True, exist_ok=True)
            convert_file(path, to, wanted, known)
        except OSError as problem:
            raise InputError(f"{to.parent}: cannot be made: {reason(problem)}") from None
        except FileError as problem:
            failed.append(problem)
    for each in failed:
        print_finding("error", each)
    if failed:
        text = f"{len(failed)} of {len(folder.documents) + len(folder.unreadable)} files"
        errors.print(labelled("not written", "bold red", text), soft_wrap=True)
        raise SystemExit(BAD_INPUT)
