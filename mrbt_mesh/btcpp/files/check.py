"""Checks a file and the files it includes against BehaviorTree.CPP's rules.

Lenient checking reports an error only where the file has no clear meaning. It warns where the
meaning is clear but BehaviorTree.CPP would refuse the file: many files in use break these rules.
Strict checking accepts only files that BehaviorTree.CPP loads and can tick.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mrbt_mesh.btcpp.files.builtin_nodes import BUILTIN
from mrbt_mesh.btcpp.files.check_entries import check_entries
from mrbt_mesh.btcpp.files.check_nodes import NodeChecker
from mrbt_mesh.btcpp.files.check_values import hint, name_problem, port_name_problem
from mrbt_mesh.btcpp.files.document import (
    EXPLICIT_TAGS,
    INCLUDE,
    MODELS,
    SUBTREE,
    TREE,
    Direction,
    Document,
    type_id,
)
from mrbt_mesh.btcpp.files.elements import Element
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.files.library import Library, load_library

MAX_CYCLE_NAMES = 10
_MODEL_TAGS = frozenset({*Direction, "description", "MetadataFields"})


def check_file(
    path: Path,
    is_strict: bool = False,
    package_folders: Sequence[Path] | None = None,
    others: Library | None = None,
) -> tuple[Library, Findings]:
    """Read and check a file. It may use the trees and models of `others`.

    Raises FileError if the file cannot be read as XML with a <root>.
    """
    findings = Findings(is_strict)
    library = load_library(path, findings, package_folders, others)
    check_library(library, findings)
    return library, findings


def check_library(library: Library, findings: Findings) -> None:
    """Add a finding for each problem in the documents of `library`."""
    for document in library.documents:
        _Checker(library, document, findings).check()
    _check_main_tree(library, findings)
    _check_duplicates(library, findings)
    _check_recursion(library, findings)
    check_entries(library, findings)


class _Checker:
    def __init__(self, library: Library, document: Document, findings: Findings) -> None:
        self.library = library
        self.document = document
        self.findings = findings

    def error(self, element: Element, path: str, message: str) -> None:
        self.findings.error(self.document.file, element.line, path, message)

    def rule(self, element: Element, path: str, message: str) -> None:
        self.findings.rule(self.document.file, element.line, path, message)

    def warn(self, element: Element, path: str, message: str) -> None:
        self.findings.warn(self.document.file, element.line, path, message)

    def check(self) -> None:
        root = self.document.root
        version = root.attributes.get("BTCPP_format")
        if version is not None and version.strip() != "4":
            message = f"BTCPP_format={version!r} is not known, only 3 and 4; it is read as 4"
            self.warn(root, "root", message)
        for element in root.children:
            if element.tag not in (TREE, INCLUDE, MODELS):
                self.warn(element, "root", f"<{element.tag}> means nothing here; it is kept")
        if root.text:
            self.warn(root, "root", "text between the elements means nothing; it is kept")
        lists = self.document.model_lists
        for extra in lists[1:]:
            message = f"a second <{MODELS}>; the first is in line {lists[0].line}"
            self.error(extra, f"root/{MODELS}", message)
        for models in lists:
            self.check_models(models)
        for tree in self.document.trees:
            self.check_tree(tree)

    def check_tree(self, tree: Element) -> None:
        name = tree.get("ID")
        path = name or TREE
        if not name and len(self.document.root.children) > 1:
            self.error(tree, path, f"<{TREE}> needs an ID, since it is not alone in the file")
        if problem := name_problem(name):
            self.rule(tree, path, problem)
        if name in BUILTIN or name in self.library.models:
            self.error(tree, path, f"{name!r} is the name of a node; give the tree another ID")
        count = len(tree.children)
        if count != 1:
            self.error(tree, path, f"<{TREE}> needs exactly one child, it has {count}")
        checker = NodeChecker(self.library, self.document.file, self.findings)
        for child in tree.children:
            checker.check(child, path)

    def check_models(self, models: Element) -> None:
        """Check <TreeNodesModel>: errors for models of SubTrees, mostly warnings for the rest.

        BehaviorTree.CPP reads only the models of SubTrees; the rest is for Groot2.
        """
        seen: dict[str, int] = {}
        for model in models.children:
            path = f"{MODELS}/{type_id(model) or model.tag}"
            if model.tag not in EXPLICIT_TAGS:
                listed = ", ".join(sorted(EXPLICIT_TAGS))
                self.warn(model, path, f"<{model.tag}> is not a kind of node; known: {listed}")
                continue
            name = model.get("ID")
            if not name:
                note = self.error if model.tag == SUBTREE else self.warn
                note(model, path, f"<{model.tag}> needs an ID in <{MODELS}>")
            elif problem := name_problem(name):
                self.rule(model, path, problem)
            if name in seen:
                self.warn(model, path, f"{name!r} is described in line {seen[name]} already")
            seen.setdefault(name, model.line)
            if name in BUILTIN and BUILTIN[name].category != model.tag:
                message = f"{name!r} is built in, as <{BUILTIN[name].category}>"
                self.warn(model, path, message)
            for port in model.children:
                self.check_port(port, model, path)

    def check_port(self, port: Element, model: Element, path: str) -> None:
        if port.tag not in _MODEL_TAGS:
            known = hint(port.tag, [str(tag) for tag in Direction])
            self.warn(port, path, f"<{port.tag}> is not a port{known}")
        elif port.tag in frozenset(Direction):
            name = port.get("name")
            if not name:
                note = self.rule if model.tag == SUBTREE else self.warn
                note(port, path, f"<{port.tag}> needs the attribute 'name'")
            elif problem := port_name_problem(name):
                self.warn(port, path, problem)


def _check_main_tree(library: Library, findings: Findings) -> None:
    first = library.documents[0]
    root = first.root
    trees = library.own_trees
    if not trees:
        findings.rule(first.file, root.line, "root", f"there is no <{TREE}>")
    elif first.main_tree and first.main_tree not in library.trees:
        message = f"main_tree_to_execute names {first.main_tree!r}, which is not a tree"
        message += hint(first.main_tree, library.trees)
        findings.rule(first.file, root.line, "root", message)
    elif library.main_tree is None:
        message = f"one of {len(trees)} trees has to be named in main_tree_to_execute"
        findings.rule(first.file, root.line, "root", message + hint("", trees))


def _check_duplicates(library: Library, findings: Findings) -> None:
    first: dict[str, str] = {}
    for source in library.registered:
        file, line = source.document.file, source.element.line
        if source.id in first:
            message = f"there is a tree {source.id!r} already, in {first[source.id]}"
            message += "; BehaviorTree.CPP takes the last one"
            findings.warn(file, line, source.id, message)
        first[source.id] = f"{file}:{line}"


def _check_recursion(library: Library, findings: Findings) -> None:
    """Search the trees depth first: a tree that is reached while it is open contains itself."""
    finished: set[str] = set()
    for start in library.own_trees:
        waiting = {start: _references(library, start)}
        while waiting and not findings.is_full:
            name = next(reversed(waiting))
            if not waiting[name]:
                finished.add(name)
                del waiting[name]
                continue
            element = waiting[name].pop()
            inner = element.get("ID")
            if inner in waiting:
                open_trees = list(waiting)
                cycle = [*open_trees[open_trees.index(inner) :], inner]
                if len(cycle) > MAX_CYCLE_NAMES:
                    cycle[MAX_CYCLE_NAMES // 2 : -MAX_CYCLE_NAMES // 2] = ["..."]
                message = f"a tree cannot contain itself: {' -> '.join(cycle)}"
                file = library.trees[name].document.file
                findings.error(file, element.line, f"{name}/{inner}", message)
            elif inner in library.trees and inner not in finished:
                waiting[inner] = _references(library, inner)


def _references(library: Library, name: str) -> list[Element]:
    """Return the SubTree elements of a tree, the last one first."""
    found = [element for element in library.trees[name].element.walk() if element.tag == SUBTREE]
    return found[::-1]
