"""Documents: what their links and their code name must exist."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

from tests.support.structure.source import Finding, files

_FENCE = re.compile(r"^ {0,3}(```|~~~)")
_LINK = re.compile(r"\]\(\s*<?([^)\s>]+)>?(?:\s+\"[^\"]*\")?\s*\)")
_DEFINITION = re.compile(r"^ {0,3}\[[^\]]+\]:\s*<?(\S+?)>?\s*$", re.MULTILINE)
_HEADING = re.compile(r"^ {0,3}#{1,6}\s+(.*?)\s*#*\s*$", re.MULTILINE)
_CODE = re.compile(r"(`+)(.+?)\1", re.DOTALL)
_ELSEWHERE = re.compile(r"^[a-z][a-z0-9+.-]*:", re.IGNORECASE)
# A path in code, such as `tests/core/test_plan.py` or `drills/*.yaml`; no options, no spaces.
_PATH = re.compile(r"^[\w.-]+(/[\w.*-]+)*/?$")


def documents(root: Path) -> list[Path]:
    """All Markdown files, those in hidden folders left out."""
    return files(root, ".md", ".")


def prose_and_blocks(text: str) -> tuple[str, list[str]]:
    """A document without its code blocks, and these, each as one text."""
    prose: list[str] = []
    blocks: list[list[str]] = []
    fence = ""
    is_indented = False
    for line in text.splitlines():
        opening = _FENCE.match(line)
        if fence or opening:
            mark = opening[1] if opening else ""
            if not fence:
                fence = mark
                blocks.append([])
            elif mark == fence:
                fence = ""
            else:
                blocks[-1].append(line)
            is_indented = False
        elif line.startswith("    ") and (is_indented or not prose or not prose[-1].strip()):
            if not is_indented:
                blocks.append([])
            blocks[-1].append(line[4:])
            is_indented = True
        elif is_indented and not line.strip():
            blocks[-1].append("")
        else:
            is_indented = False
            prose.append(line)
    return "\n".join(prose), ["\n".join(block) for block in blocks]


def broken_links(root: Path) -> list[Finding]:
    """Relative links whose file, or heading in it, does not exist."""
    found = []
    for path in documents(root):
        prose, _ = prose_and_blocks(path.read_text(encoding="utf-8"))
        text = _CODE.sub(lambda code: " " * len(code[0]), prose)
        targets = [*_LINK.findall(text), *_DEFINITION.findall(text)]
        for target in targets:
            if not _ELSEWHERE.match(target):
                problem = _missing(path, unquote(target))
                if problem:
                    key = f"{path.relative_to(root).as_posix()}: {target}"
                    found.append(Finding(key, problem))
    return found


def _missing(document: Path, target: str) -> str:
    """What is wrong with a relative link; nothing: empty."""
    place, _, anchor = target.partition("#")
    file = document.parent / place if place else document
    if not file.exists():
        return "there is no such file"
    if anchor and (file.suffix != ".md" or anchor not in anchors(file.read_text(encoding="utf-8"))):
        return "there is no such heading"
    return ""


def anchors(text: str) -> set[str]:
    """What a document's headings are called in links, by GitHub's rule."""
    prose, _ = prose_and_blocks(text)
    counted: Counter[str] = Counter()
    found = set()
    for heading in _HEADING.findall(prose):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).replace("`", "").lower()
        name = re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")
        found.add(f"{name}-{counted[name]}" if counted[name] else name)
        counted[name] += 1
    return found


def code_of(text: str) -> Iterator[str]:
    """The code in a document: spans in its prose, then its blocks."""
    prose, blocks = prose_and_blocks(text)
    for _, code in _CODE.findall(prose):
        yield " ".join(code.split())
    yield from blocks


def missing_paths(root: Path, *bases: str) -> list[Finding]:
    """Paths in code spans that do not exist; they may be relative to `root` or one of `bases`.

    A path is one whose first part is a file or folder in one of these places.
    """
    places = [root, *(root / base for base in bases)]
    found = []
    for document in documents(root):
        prose, _ = prose_and_blocks(document.read_text(encoding="utf-8"))
        for _, code in _CODE.findall(prose):
            homes = [place for place in places if (place / code.split("/")[0]).exists()]
            if "/" in code and _PATH.match(code) and homes:
                pattern = code.rstrip("/")
                if not any(next(home.glob(pattern), None) for home in homes):
                    key = f"{document.relative_to(root).as_posix()}: {code}"
                    found.append(Finding(key, "there is no such file or folder"))
    return found
