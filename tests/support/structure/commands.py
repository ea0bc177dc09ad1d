"""Commands that documents name: make's targets, and what `mrbt` can do."""

from __future__ import annotations

import re
import shlex
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

from tests.support.structure.markdown import code_of, documents
from tests.support.structure.source import Finding

# What `mrbt` knows: options by command, `tree show` for a command in a group; "" for `mrbt` alone.
Commands = Mapping[str, Collection[str]]

_TARGET = re.compile(r"^([A-Za-z][\w-]*)\s*:(?!=)", re.MULTILINE)
_WORD = re.compile(r"^[a-z][a-z0-9-]*$")
_OPTION = re.compile(r"^--?[A-Za-z][\w-]*")
_ENDS = {";", "&&", "||", "|", "&", ">", ")"}


def unknown_targets(root: Path) -> list[Finding]:
    """Targets of make, named in documents, that the Makefile lacks."""
    known = set(_TARGET.findall((root / "Makefile").read_text(encoding="utf-8")))
    return [
        Finding(f"{where}: make {word}", "the Makefile has no such target")
        for where, words in _calls(root, "make")
        for word in words
        if _WORD.match(word) and word not in known
    ]


def unknown_commands(root: Path, known: Commands) -> list[Finding]:
    """Commands and options of `mrbt`, named in documents, that do not exist."""
    groups = {command.split()[0] for command in known if " " in command}
    found = []
    for where, words in _calls(root, "mrbt"):
        named = [word for word in words[:2] if _WORD.match(word)]
        if words and words[0] in groups:
            command = " ".join(named)
        else:
            command = named[0] if words and words[0] in named else ""
        if command in groups:
            continue  # of the group as a whole
        if command not in known:
            found.append(Finding(f"{where}: mrbt {command}", "there is no such command"))
            continue
        for word in words:
            option = _OPTION.match(word)
            if option and option[0] not in known[command]:
                text = "the command has no such option"
                found.append(Finding(f"{where}: mrbt {command} {option[0]}", text))
    return found


def unknown_options(root: Path, known: Commands) -> list[Finding]:
    """Options that stand alone in code, as in "with `--json`", and that no command has."""
    options = {option for each in known.values() for option in each}
    found = []
    for document in documents(root):
        for code in code_of(document.read_text(encoding="utf-8")):
            option = _OPTION.match(code)
            if option and option[0] not in options:
                key = f"{document.relative_to(root).as_posix()}: {option[0]}"
                found.append(Finding(key, "no command has such an option"))
    return found


def _calls(root: Path, program: str) -> Iterator[tuple[str, list[str]]]:
    """(document, arguments) for each call of a program in the code of the documents."""
    for document in documents(root):
        where = document.relative_to(root).as_posix()
        for code in code_of(document.read_text(encoding="utf-8")):
            for line in code.replace("\\\n", " ").splitlines():
                for words in _commands(line):
                    if words[0] == program:
                        yield where, words[1:]


def _commands(line: str) -> Iterator[list[str]]:
    """The commands in one line of a shell, each as its words."""
    lexer = shlex.shlex(line, posix=True, punctuation_chars=True)
    lexer.whitespace_split = True
    lexer.commenters = "#"
    try:
        words = list(lexer)
    except ValueError:
        return  # quotes that do not match: no line of a shell
    command: list[str] = []
    for word in [*words, ";"]:
        if word in _ENDS:
            if command:
                yield command
            command = []
        else:
            command.append(word)
