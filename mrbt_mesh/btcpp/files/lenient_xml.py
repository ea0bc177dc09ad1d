"""Repairs invalid XML that BehaviorTree.CPP's reader, tinyxml2, accepts.

It accepts raw `<` and `&` instead of `&lt;` and `&amp;`, as in `_skipIf="a < 3 && b"`, attributes
with no space between them, as in `<Go to="a"speed="2"/>`, and `--` inside comments.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

_IN_XML = {"&": "&amp;", "<": "&lt;"}
_RAW = {
    "&": re.compile(r"&(?!(?:amp|lt|gt|quot|apos|#[0-9]+|#[xX][0-9a-fA-F]+);)"),
    "<": re.compile("<"),
}
# Possessive quantifiers, so the pattern never backtracks.
_TAG = re.compile(r"""</?[^\W\d](?:[^"'<>]++|"[^"]*+"|'[^']*+')*+>""")
# Text after this many `<` is not repaired: a file with more elements is refused anyway.
MAX_MARKUP = 400_000
_COMMENT = "<!--"
_CLOSED_BY = ((_COMMENT, "-->"), ("<![CDATA[", "]]>"), ("<?", "?>"))
_HYPHENS = re.compile("-(?=-)")
_VALUE = re.compile(r"""([^\s=<>"'/]++)(\s*+=\s*+)("[^"]*+"|'[^']*+')""")


def mended(text: str) -> tuple[str, list[tuple[int, str]]]:
    """Return the text as XML, and (line, what was repaired) for each place.

    Lines count from 1. Other errors in the text are left alone.
    """
    parts: list[str] = []
    notes: list[tuple[int, str]] = []
    done = line = 0
    for start, end, value, where in _suspects(text):
        kept, found = _mend(value, where, text[end : end + 1])
        if not found:
            continue
        at = start + min(index for index, _ in found)
        line += text.count("\n", done, at)
        place = "comment" if where == _COMMENT else f"attribute {where!r}" if where else "text"
        notes.append((line + 1, f"{place}: {' and '.join(message for _, message in found)}"))
        parts += (text[done:start], kept)
        line += text.count("\n", at, end)
        done = end
    return "".join([*parts, text[done:]]), notes


def _mend(value: str, where: str, behind: str) -> tuple[str, list[tuple[int, str]]]:
    """Return a text or value as XML, and its errors as pairs of position and message."""
    if where == _COMMENT:
        at = f"{value}-".find("--")
        # A `-` right before the closing `-->` also makes a `--`.
        kept = _HYPHENS.sub("- ", f"{value}-")[:-1]
        return kept, [] if at < 0 else [(at, "'--', which XML does not allow; taken for '- -'")]
    found = []
    kept = value
    for character, pattern in _RAW.items():
        if (raw := pattern.search(value)) and (where or character != "<"):
            in_xml = _IN_XML[character]
            found.append((raw.start(), f"a raw {character!r} ({in_xml} in XML); taken for text"))
            kept = pattern.sub(in_xml, kept)
    if where and (behind == ":" or behind == "_" or behind.isalpha()):
        found.append((len(value) - 1, "no space behind it; taken for one"))
        kept += " "
    return kept, found


def _suspects(text: str) -> Iterator[tuple[int, int, str, str]]:
    """Yield (begin, end, text, attribute) of texts, attribute values and comments.

    The attribute is empty for a text, and `<!--` for a comment.
    """
    place = 0
    for _ in range(MAX_MARKUP):
        begin = text.find("<", place)
        end = len(text) if begin < 0 else begin
        if text.find("&", place, end) >= 0:
            yield place, end, text[place:end], ""
        if begin < 0:
            return
        place = begin + 1
        if tag := _TAG.match(text, begin):
            place = tag.end()
            for found in _VALUE.finditer(text, begin, place):
                yield found.start(3), found.end(3), found[3], found[1]
            continue
        for opening, closing in _CLOSED_BY:
            if text.startswith(opening, begin):
                content_at = begin + len(opening)
                found_at = text.find(closing, content_at)
                if found_at < 0:
                    return
                if opening == _COMMENT:
                    yield content_at, found_at, text[content_at:found_at], _COMMENT
                place = found_at + len(closing)
