"""Raw `<` and `&` in XML, which BehaviorTree.CPP's reader takes for what they are.

XML wants `&lt;` and `&amp;`; people write `_skipIf="a < 3 && b"`, and tinyxml2 reads it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

_IN_XML = {"&": "&amp;", "<": "&lt;"}
_RAW_AMPERSAND = re.compile(r"&(?!(?:amp|lt|gt|quot|apos|#[0-9]+|#[xX][0-9a-fA-F]+);)")
# Possessive, so that nothing is tried twice.
_TAG = re.compile(r"""</?[^\W\d](?:[^"'<>]++|"[^"]*+"|'[^']*+')*+>""")
# What is behind so many `<` stays as it is: a file with more elements is refused anyway.
MAX_MARKUP = 400_000
_CLOSED_BY = (("<!--", "-->"), ("<![CDATA[", "]]>"), ("<?", "?>"))
_VALUE = re.compile(r"""([^\s=<>"'/]++)(\s*+=\s*+)("[^"]*+"|'[^']*+')""")


def escaped(text: str) -> tuple[str, list[tuple[int, str]]]:
    """The text with its raw characters escaped, and (line, what was raw) for each place.

    Lines count from 1. Whatever else is wrong with the text stays as it is.
    """
    parts: list[str] = []
    notes: list[tuple[int, str]] = []
    done = line = 0
    for start, end, value, where in _suspects(text):
        kept = _RAW_AMPERSAND.sub("&amp;", value)
        raw = ["&"] if kept != value else []
        if where and "<" in value:
            kept = kept.replace("<", "&lt;")
            raw.append("<")
        if not raw:
            continue
        found = _RAW_AMPERSAND.search(value)
        at = start + min(found.start() if found else len(value), value.find("<") % (len(value) + 1))
        line += text.count("\n", done, at)
        listed = " and ".join(f"{c!r} ({_IN_XML[c]} in XML)" for c in raw)
        place = f"attribute {where!r}" if where else "text"
        notes.append((line + 1, f"{place}: a raw {listed}; taken for text"))
        parts += (text[done:start], kept)
        line += text.count("\n", at, end)
        done = end
    return "".join([*parts, text[done:]]), notes


def _suspects(text: str) -> Iterator[tuple[int, int, str, str]]:
    """(begin, end, text, attribute) of texts, which have no attribute, and of values."""
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
            if "&" in tag[0] or "<" in tag[0][1:]:
                for found in _VALUE.finditer(text, begin, place):
                    yield found.start(3), found.end(3), found[3], found[1]
            continue
        for opening, closing in _CLOSED_BY:
            if text.startswith(opening, begin):
                found_at = text.find(closing, begin)
                if found_at < 0:
                    return
                place = found_at + len(closing)
