"""A file and the files it includes: one set of trees and one of node models."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from mrbt_mesh.btcpp.files.builtin_nodes import BUILTIN, NAV2_NODES
from mrbt_mesh.btcpp.files.document import (
    SUBTREE,
    Category,
    Document,
    NodeManifest,
    parse_document,
    ports,
    read_document,
)
from mrbt_mesh.btcpp.files.elements import Element
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.files.upgrade import upgrade
from mrbt_mesh.btcpp.files.xml_reader import MAX_BYTES
from mrbt_mesh.btcpp.scripts.values import read_boolean
from mrbt_mesh.errors import FileError, Problem, nearest, whole_file_error

MAX_FILES = 100
LONE_TREE = "BehaviorTree"


@dataclass(frozen=True, slots=True)
class TreeSource:
    """A <BehaviorTree> and its document."""

    id: str
    document: Document
    element: Element


@dataclass
class Library:
    """Documents of version 4, starting with the main file; trees and models by ID.

    A tree without an ID, which must be the only one, is called `BehaviorTree`. `registered` has the
    trees of the documents in BehaviorTree.CPP's order: included files before the file that includes
    them. `trees` and the models may also come from other files, which are not in `documents`.
    """

    documents: list[Document] = field(default_factory=list)
    registered: list[TreeSource] = field(default_factory=list)
    trees: dict[str, TreeSource] = field(default_factory=dict)
    models: dict[str, NodeManifest] = field(default_factory=dict)
    subtree_models: dict[str, NodeManifest] = field(default_factory=dict)
    missing_files: list[str] = field(default_factory=list)

    @property
    def main_tree(self) -> str | None:
        """The ID of the tree that BehaviorTree.CPP would execute; None if it would not load.

        The first document names it, or it is the only tree of that document, or of all documents.
        """
        first = self.documents[0]
        if named := first.main_tree:
            return named if named in self.trees else None
        if "main_tree_to_execute" not in first.root.attributes and len(first.trees) == 1:
            return first.trees[0].get("ID") or LONE_TREE
        return next(iter(self.own_trees)) if len(self.own_trees) == 1 else None

    def chosen_tree(self, tree: str | None = None) -> str:
        """Return `tree`, or by default the ID of the main tree. Raises FileError if not found."""
        name = tree or self.main_tree
        if name is not None and name in self.trees:
            return name
        first = self.documents[0]
        if tree:
            message = f"there is no tree {tree!r}{nearest(tree, list(self.trees))}"
            raise whole_file_error(first.file, message)
        known = ", ".join(self.trees) or "none"
        message = f"main_tree_to_execute names none of the trees; name one of: {known}"
        raise FileError([Problem(first.file, first.root.line, "root", message)])

    @property
    def own_trees(self) -> dict[str, TreeSource]:
        """The trees of the documents, without those known from other files."""
        own = {id(document) for document in self.documents}
        return {name: each for name, each in self.trees.items() if id(each.document) in own}

    def model(self, name: str) -> NodeManifest | None:
        """Return the model of a node: built in, from the files, or Nav2's; else None."""
        return BUILTIN.get(name) or self.models.get(name) or NAV2_NODES.get(name)

    def subtree_ports(self, element: Element) -> tuple[bool, dict[str, str], list[str]]:
        """Return whether a <SubTree> remaps every entry, its ports, and its missing ports.

        Ports with a default in its model count as given.
        """
        remaps_all = read_boolean(element.get("_autoremap", "false")) or False
        given = ports(element)
        model = None if remaps_all else self.subtree_models.get(element.get("ID"))
        declared = [] if model is None else list(model.ports.values())
        left_out = [port for port in declared if port.name not in given]
        given |= {port.name: port.default for port in left_out if port.default}
        return remaps_all, given, [port.name for port in left_out if not port.default]

    def know(self, other: Library) -> None:
        """Add the trees and models of another library, but not its documents."""
        self.trees = other.trees | self.trees
        self.models = other.models | self.models
        self.subtree_models = other.subtree_models | self.subtree_models

    def take_in(self, tree: str) -> None:
        """Add the documents of all trees that `tree` uses, directly or indirectly."""
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
        """Turn SubTrees that no file defines into actions with the same ports. `*`: all of them.

        Raises ValueError for an ID that a tree has, or that no SubTree node uses.
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
        """Add a document with its trees and models. If an ID occurs twice, the last one counts."""
        self.documents.append(document)
        self.register(document)

    def register(self, document: Document) -> None:
        """Register the trees and models of a document."""
        for element in document.trees:
            name = element.get("ID") or LONE_TREE
            self.trees[name] = TreeSource(name, document, element)
            self.registered.append(self.trees[name])
        for name, model in document.models().items():
            is_subtree = model.category is Category.SUBTREE
            (self.subtree_models if is_subtree else self.models)[name] = model


def load_library(
    path: Path,
    findings: Findings,
    package_folders: Sequence[Path] | None = None,
    others: Library | None = None,
) -> Library:
    """Read a file and the files it includes; files of version 3 are converted to version 4.

    `package_folders` are searched for the packages of `ros_pkg`; by default those of ROS 2
    (AMENT_PREFIX_PATH). Trees and models of `others` are added. Unreadable includes, and changes,
    are added to `findings`. Raises FileError if the file itself cannot be read.
    """
    return _load(path, read_document(path), findings, package_folders, others)


def load_text(
    text: str, path: Path, findings: Findings, package_folders: Sequence[Path] | None = None
) -> Library:
    """Like `load_library`, from memory; includes are relative to the folder of `path`."""
    return _load(path, parse_document(text, str(path)), findings, package_folders, None)


def _load(
    path: Path,
    document: Document,
    findings: Findings,
    package_folders: Sequence[Path] | None,
    others: Library | None,
) -> Library:
    if package_folders is None:
        prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
        package_folders = [Path(prefix) / "share" for prefix in prefixes if prefix]
    loader = _Loader(Library(), findings, package_folders)
    loader.load(path, document, ())
    if others is not None:
        loader.library.know(others)
    return loader.library


def together(documents: Iterable[Document]) -> Library:
    """Return one library with the trees and models of many files; findings are discarded."""
    library = Library()
    for document in documents:
        library.add(upgrade(document, Findings()))
    return library


def library_of(document: Document, findings: Findings) -> Library:
    """Return a library of one document; its includes are not followed."""
    library = Library()
    library.add(_read(document, findings))
    library.missing_files.extend(include.get("path") for include in document.includes)
    return library


def _read(document: Document, findings: Findings) -> Document:
    """Convert a document to version 4; adds findings about its XML and its version."""
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
        document = _read(document, self.findings)
        self.library.documents.append(document)
        here = path.resolve()
        self.loaded.add(here)
        for element in document.includes:
            self.include(path, document, element, (*including, here))
        self.library.register(document)

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
        """Return the file that an <include> names, relative to its own file or to a package."""
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
