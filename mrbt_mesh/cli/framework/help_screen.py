"""Help screens: usage, what the command does, and its arguments and options in panels."""

from __future__ import annotations

import io
import re
import sys
from collections.abc import Iterable, Mapping, Sequence

import click
from rich.console import Console
from rich.padding import Padding
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from mrbt_mesh.cli.framework.parameters import Argument, Option
from mrbt_mesh.cli.framework.values import NumberType, PathType

NAME, TYPE, QUIET, USAGE = "bold cyan", "bold yellow", "dim", "yellow"
_OPTION = re.compile(r"(?<![\w-])--?[a-zA-Z][\w-]*")
# The name, what may be given, and what it is for.
Row = tuple[Text, Text, Text]


def command_help(command: click.Command, context: click.Context) -> str:
    """The help screen of one command."""
    panels: dict[str, list[Row]] = {"Arguments": [], "Options": []}
    for parameter in command.get_params(context):
        if isinstance(parameter, Argument):
            panels["Arguments"].append(_argument(parameter))
        elif isinstance(parameter, click.Option):
            panel = parameter.panel if isinstance(parameter, Option) else None
            panels.setdefault(panel or "Options", []).append(_option(parameter))
    first, *rest = _paragraphs(command.help or "")
    said = [_usage(command, context), Text(first), *(_marked(text, QUIET) for text in rest)]
    return _drawn(said, [(title, _table(rows)) for title, rows in panels.items() if rows])


def group_help(
    group: click.Group,
    context: click.Context,
    panels: Mapping[str, Mapping[str, str]],
    example: str,
) -> str:
    """The help screen of a group: its commands in panels, each with one line."""
    options = [_option(p) for p in group.get_params(context) if isinstance(p, click.Option)]
    width = max(len(name) for lines in panels.values() for name in lines)
    tables: list[tuple[str, Table]] = [("Options", _table(options))]
    for title, lines in panels.items():
        table = _grid()
        table.add_column(width=width, no_wrap=True)
        table.add_column(ratio=1)
        for name, line in lines.items():
            table.add_row(Text(name, NAME), line)
        tables.append((title, table))
    return _drawn([_usage(group, context), Text(group.help or "")], tables, f"Example: {example}")


def _drawn(paragraphs: Iterable[Text], tables: Iterable[tuple[str, Table]], end: str = "") -> str:
    """All of it as text, in colours if stdout is a terminal."""
    drawn = io.StringIO()
    console = Console(file=drawn, force_terminal=sys.stdout.isatty() or None, highlight=False)
    for paragraph in paragraphs:
        console.print(Padding(paragraph, (1, 1, 0, 1), expand=False))
    console.print()
    for title, table in tables:
        panel = Panel(table, title=title, title_align="left", border_style=QUIET)
        console.print(panel)
    if end:
        console.print(Padding(_marked(end, ""), (1, 1), expand=False))
    return "\n".join(line.rstrip() for line in drawn.getvalue().rstrip().split("\n"))


def _paragraphs(text: str) -> list[str]:
    """The paragraphs of a docstring, each in one line."""
    return [" ".join(part.split()) for part in text.strip().split("\n\n")]


def _usage(command: click.Command, context: click.Context) -> Text:
    pieces = [context.command_path, "[OPTIONS]"]
    for argument in (p for p in command.get_params(context) if isinstance(p, Argument)):
        many = "..." if argument.nargs == -1 else ""
        name = argument.human_readable_name
        pieces.append(f"{name}{many}" if argument.required else f"[{name}]{many}")
    if isinstance(command, click.Group):
        pieces.append("COMMAND [ARGS]...")
    return Text.assemble(("Usage: ", USAGE), (" ".join(pieces), "bold"))


def _marked(text: str, style: str) -> Text:
    """A text in which options stand out."""
    found = Text(text, style)
    found.highlight_regex(_OPTION, NAME)
    return found


def _argument(argument: Argument) -> Row:
    many = "..." if argument.nargs == -1 else ""
    name = Text(f"{argument.human_readable_name}{many}", NAME)
    kind = "" if isinstance(argument.type, PathType) else _kind(argument)
    return name, Text(kind, TYPE), _said(argument.text, _remarks(argument))


def _option(option: click.Option) -> Row:
    names = ", ".join(sorted(option.opts, key=len, reverse=True))
    kind = "" if option.is_flag else option.metavar or _kind(option)
    return Text(names, NAME), Text(kind, TYPE), _said(option.help or "", _remarks(option))


def _kind(parameter: click.Parameter) -> str:
    """What may be given, where no metavar says it."""
    if isinstance(parameter.type, click.Choice):
        return "|".join(parameter.type.choices)
    return f"<{parameter.type.name}>"


def _remarks(parameter: click.Parameter) -> Sequence[str]:
    remarks = []
    if isinstance(parameter.type, NumberType) and str(parameter.type.bounds):
        remarks.append(str(parameter.type.bounds))
    if isinstance(parameter, click.Option) and parameter.show_default:
        value = parameter.default
        if isinstance(value, int | float):
            remarks.append(f"default: {value:g}")
        elif isinstance(value, str) or hasattr(value, "__fspath__"):
            remarks.append(f"default: {value}")
    if parameter.envvar is not None:
        remarks.append(f"variable: {parameter.envvar}")
    if parameter.required:
        remarks.append("required")
    return remarks


def _said(text: str, remarks: Sequence[str]) -> Text:
    said = _marked(text, "")
    if remarks:
        said.append(f" [{'; '.join(remarks)}]", QUIET)
    return said


def _grid() -> Table:
    return Table(box=None, show_header=False, expand=True, pad_edge=False, padding=(0, 1))


def _table(rows: Iterable[Row]) -> Table:
    table = _grid()
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    table.add_column(ratio=1)
    for row in rows:
        table.add_row(*row)
    return table
