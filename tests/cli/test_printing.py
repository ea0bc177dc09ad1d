"""What is printed: wrapped, aligned, in colours only where they are wanted."""

from __future__ import annotations

import io
import sys

import pytest

from mrbt_mesh.cli.printing import Console, Panel, PrintedTree, Stack, Styled, Table, plain


def test_a_text_is_wrapped_between_words_and_within_long_ones() -> None:
    text = Styled.assemble("one ", ("two", "bold"), "three four")
    assert text.plain == "one twothree four"
    assert plain(text, 9) == "one\ntwothree\nfour\n"
    assert plain(Styled("abcdefgh ij"), 5) == "abcde\nfgh\nij\n"
    assert plain(Styled("a b c", no_wrap=True), 3) == "a b c\n"
    assert plain("a\nb") == "a\nb\n"


def test_texts_are_joined_and_appended_with_their_styles() -> None:
    joined = Styled(", ", "dim").join([Styled("a", "red"), Styled("b")]).append("!", "bold")
    assert joined.spans == [("a", "red"), (", ", "dim"), ("b", ""), ("!", "bold")]


def test_a_table_is_aligned_and_gives_way_in_its_widest_column() -> None:
    table = Table(("name", "count", "what"), right=(1,))
    table.add_row("long_name_is_kept", "7", Styled("a few words that have to be wrapped"))
    table.add_row("b", "12")
    assert table.row_count == 2
    assert plain(table, 45).splitlines() == [
        "name               count  what",
        "long_name_is_kept      7  a few words that",
        "                          have to be wrapped",
        "b                     12",
    ]


def test_signs_of_two_columns_count_twice() -> None:
    table = Table(("", ""))
    table.add_row("\u4e2d\u6587", "a")
    table.add_row("abcd", "b")
    assert plain(table).splitlines() == ["\u4e2d\u6587  a", "abcd  b"]


def test_trees_frames_and_groups() -> None:
    tree = PrintedTree(Styled("top"))
    tree.add(Styled("first")).add(Styled("below"))
    tree.add(Styled("last"))
    assert plain(Stack(tree, Panel(Styled("in\nside"), "red"))).splitlines() == [
        *("top", "├── first", "│   └── below", "└── last"),
        *("╭──────╮", "│ in   │", "│ side │", "╰──────╯"),
    ]


class Screen(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    ("stream", "variables", "text"),
    [
        (Screen, {"TERM": "xterm"}, "\x1b[1;31ma\x1b[0mb\n"),
        (Screen, {"TERM": "dumb"}, "ab\n"),
        (Screen, {"TERM": "xterm", "NO_COLOR": "1"}, "ab\n"),
        (io.StringIO, {"TERM": "xterm"}, "ab\n"),
        (io.StringIO, {"FORCE_COLOR": "1"}, "\x1b[1;31ma\x1b[0mb\n"),
    ],
)
def test_styles_are_for_terminals(
    monkeypatch: pytest.MonkeyPatch, stream: type, variables: dict[str, str], text: str
) -> None:
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "stderr", stream())
    console = Console(is_stderr=True)
    console.print(Styled.assemble(("a", "bold red"), "b"))
    assert console.stream.getvalue() == text  # type: ignore[attr-defined]


def test_with_soft_wrap_lines_stay_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", io.StringIO())
    monkeypatch.setenv("COLUMNS", "10")
    console = Console()
    console.print("twelve signs", soft_wrap=True)
    console.print("twelve signs")
    console.print()
    assert console.stream.getvalue() == "twelve signs\ntwelve\nsigns\n\n"  # type: ignore[attr-defined]
