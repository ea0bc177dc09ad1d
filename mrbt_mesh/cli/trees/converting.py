"""Trees written as BehaviorTree.CPP 4 XML."""

from __future__ import annotations

from pathlib import Path

from mrbt_mesh.cli.trees.files import is_mission, read_tree_file
from mrbt_mesh.errors import InputError
from mrbt_mesh.formats.btcpp.document import Document
from mrbt_mesh.formats.btcpp.export import explicit, team_tree_document, with_ids
from mrbt_mesh.formats.btcpp.findings import Finding
from mrbt_mesh.formats.btcpp.library import Library
from mrbt_mesh.formats.mission_file import load_mission


def converted(source: Path, merge: bool, ids: bool) -> tuple[Document, list[Finding]]:
    """The document of a file's trees, and warnings; raises InputError for a file with errors."""
    if is_mission(source):
        if ids or merge:
            raise InputError("--ids and --merge are for BehaviorTree.CPP files")
        library = Library()
        library.add(team_tree_document(load_mission(source).tree.spec(), str(source)))
        return explicit(library), []
    library, findings = read_tree_file(source)
    findings.raise_errors()
    document = with_ids(library) if ids else explicit(library, is_merged=merge)
    return document, findings.warnings
