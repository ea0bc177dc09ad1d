"""A file with everything that it includes: one set of trees and one of node models."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from mrbt_mesh.btcpp.files.builtin_nodes import BUILTIN
from mrbt_mesh.btcpp.files.document import (
    SUBTREE,
    Category,
    Document,
    NodeManifest,
    ports,
    read_document,
)
from mrbt_mesh.btcpp.files.elements import Element
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.files.upgrade import upgrade
from mrbt_mesh.btcpp.files.xml_reader import MAX_BYTES
from mrbt_mesh.btcpp.scripts.values import read_boolean
from mrbt_mesh.errors import FileError, nearest

MAX_FILES = 100


@dataclass(frozen=True, slots=True)
class TreeSource:
    """A <BehaviorTree> and its document."""

    id: str
    document: Document
    element: Element


@dataclass
class Library:
    """The documents, in version 4, the first one first; trees and models by their ID.

    A tree without an ID is called `BehaviorTree`, as it is the only one. Trees and models may be
    known from other files, too, which are no documents here.
    """

    documents: list[Document] = field(default_factory=list)
    trees: dict[str, TreeSource] = field(default_factory=dict)
    models: dict[str, NodeManifest] = field(default_factory=dict)
    subtree_models: dict[str, NodeManifest] = field(default_factory=dict)
    missing_files: list[str] = field(default_factory=list)

    @property
    def main_tree(self) -> str | None:
        """The ID of the tree to execute: named by the first document, or the only one there is."""
        named = self.documents[0].main_tree
        if named:
            return named if named in self.trees else None
        own = self.own_trees
        return next(iter(own)) if len(own) == 1 else None

    @property
    def own_trees(self) -> dict[str, TreeSource]:
        """The trees of the documents, without those known from other files."""
        own = {id(document) for document in self.documents}
        return {name: each for name, each in self.trees.items() if id(each.document) in own}

    def model(self, name: str) -> NodeManifest | None:
        """The model of a registered node."""
        return BUILTIN.get(name) or self.models.get(name)

    def subtree_ports(self, element: Element) -> tuple[bool, dict[str, str], list[str]]:
        """Of a <SubTree>: whether it remaps every entry, its ports, and those that are missing.

        The defaults of its model count as given.
        """
        remaps_all = read_boolean(element.get("_autoremap", "false")) or False
        given = ports(element)
        model = None if remaps_all else self.subtree_models.get(element.get("ID"))
        declared = [] if model is None else list(model.ports.values())
        left_out = [port for port in declared if port.name not in given]
        given |= {port.name: port.default for port in left_out if port.default}
        return remaps_all, given, [port.name for port in left_out if not port.default]

    def know(self, other: Library) -> None:
        """Learn trees and models of other files, which are no documents here."""
        self.trees = other.trees | self.trees
        self.models = other.models | self.models
        self.subtree_models = other.subtree_models | self.subtree_models

    def take_in(self, tree: str) -> None:
        """Make documents of the other files whose trees a tree needs, and those in turn."""
        seen, waiting = set(), [tree]
        while waiting:
            source = self.trees.get(waiting.pop())
            if source is None or source.id in seen:
                continue
            seen.add(source.id)
            if all(source.document is not document for document in self.documents):
                self.documents.append(source.document)
            used = (each for each in source.element.walk() if each.tag == SUBTREE)
            waiting.extend(each.get("ID") for each in used)

    def make_actions(self, names: Collection[str]) -> None:
        """Make SubTrees of these IDs, which no file has, actions with the same ports. `*`: all.

        Raises ValueError for one that is there, or that no node uses.
        """
        documents = {id(each.document): each.document for each in self.trees.values()}
        documents |= {id(document): document for document in self.documents}
        roots = [document.root for document in documents.values()]
        subtrees = [each for root in roots for each in root.walk() if each.tag == SUBTREE]
        used = sorted({each.get("ID") for each in subtrees} - self.trees.keys())
        names = used if "*" in names else names
        for name in names:
            if name in self.trees:
                raise ValueError(f"there is a tree {name!r}")
            if name not in used:
                raise ValueError(f"no SubTree node has the ID {name!r}{nearest(name, used)}")
        for element in (each for each in subtrees if each.get("ID") in names):
            element.tag = str(Category.ACTION)
            element.attributes.pop("_autoremap", None)
        for name in names:
            if model := self.subtree_models.pop(name, None):
                self.models[name] = replace(model, category=Category.ACTION)

    def add(self, document: Document) -> None:
        """Take over a document's trees and models. Of two of the same ID the last one counts."""
        self.documents.append(document)
        for element in document.trees:
            name = element.get("ID") or "BehaviorTree"
            self.trees[name] = TreeSource(name, document, element)
        for name, model in document.models().items():
            is_subtree = model.category is Category.SUBTREE
            (self.subtree_models if is_subtree else self.models)[name] = model


def load_library(
    path: Path,
    findings: Findings,
    package_folders: Sequence[Path] | None = None,
    others: Library | None = None,
) -> Library:
    """Read a file and what it includes; files of version 3 become version 4.

    `package_folders` are searched for the packages of `ros_pkg`; by default those of ROS 2. Trees
    and models of `others` are known besides. Includes that cannot be read, and changes, are noted
    in `findings`. Raises FileError if the file itself cannot be read.
    """
    if package_folders is None:
        prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
        package_folders = [Path(prefix) / "share" for prefix in prefixes if prefix]
    loader = _Loader(Library(), findings, package_folders)
    loader.load(path, read_document(path), ())
    if others is not None:
        loader.library.know(others)
    return loader.library


def together(documents: Iterable[Document]) -> Library:
    """One library of many files, to know their trees and models; nothing is noted."""
    library = Library()
    for document in documents:
        library.add(upgrade(document, Findings()))
    return library


def library_of(document: Document, findings: Findings) -> Library:
    """A library of one document, whose includes are not followed."""
    library = Library()
    library.add(_read(document, findings))
    library.missing_files.extend(include.get("path") for include in document.includes)
    return library


def _read(document: Document, findings: Findings) -> Document:
    """The document in version 4; notes what is odd about its XML and its version."""
    findings.warn_all(document.tolerated)
    for problem in document.refused:
        findings.rule(problem.file, problem.line, problem.path, problem.message)
    return upgrade(document, findings)


@dataclass
class _Loader:
    library: Library
    findings: Findings
    package_folders: Sequence[Path]
    loaded: set[Path] = field(default_factory=set)
    total_bytes: int = 0

    def load(self, path: Path, document: Document, including: tuple[Path, ...]) -> None:
        self.library.add(_read(document, self.findings))
        here = path.resolve()
        self.loaded.add(here)
        for element in document.includes:
            self.include(path, document, element, (*including, here))

    def include(
        self, path: Path, document: Document, element: Element, including: tuple[Path, ...]
    ) -> None:
        place = (document.file, element.line, "root/include")
        named = element.get("path")
        if not named:
            self.findings.error(*place, "<include> needs the attribute 'path'")
            return
        target = self.target(path, element, place)
        if target is None:
            self.library.missing_files.append(named)
            return
        resolved = target.resolve()
        if resolved in including:
            self.findings.error(*place, f"{named!r} includes itself")
            return
        if resolved in self.loaded:
            return
        if len(self.loaded) >= MAX_FILES:
            self.findings.error(*place, f"more than {MAX_FILES} files are included")
            return
        try:
            included = read_document(target, MAX_BYTES - self.total_bytes)
        except FileError as error:
            self.library.missing_files.append(named)
            self.loaded.add(resolved)
            if target.is_file():
                for problem in error.problems:
                    self.findings.error(problem.file, problem.line, problem.path, problem.message)
            else:
                self.findings.rule(*place, f"there is no file {str(target)!r} to include")
            return
        self.total_bytes += target.stat().st_size
        self.load(target, included, including)

    def target(self, path: Path, element: Element, place: tuple[str, int, str]) -> Path | None:
        """The file that an <include> names, relative to the including file or to a package."""
        named = Path(element.get("path"))
        package = element.get("ros_pkg")
        if not package:
            return path.parent / named
        if named.is_absolute():
            self.findings.warn(*place, "with an absolute 'path', 'ros_pkg' is ignored")
            return named
        for folder in self.package_folders:
            if (folder / package).is_dir():
                return folder / package / named
        message = f"package {package!r} is not installed; {str(named)!r} was not included"
        self.findings.rule(*place, message)
        return None
