"""Additions to click: wrong input gives a message and exit status 2, and imports are late."""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import functools
import importlib
import keyword
import os
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

import click
from click.core import ParameterSource

from mrbt_mesh import plugins
from mrbt_mesh.cli.streams import OutputError, drop_output, prepare_streams
from mrbt_mesh.errors import InputError, lone

NAME = "mrbt"
SUCCESS, FAILURE, BAD_INPUT, NOT_FINISHED = 0, 1, 2, 3
EXIT_OF_RESULT = {
    "success": SUCCESS,
    "failure": FAILURE,
    "timeout": NOT_FINISHED,
    "blocked": NOT_FINISHED,
    "ended": NOT_FINISHED,
    "not_started": NOT_FINISHED,
}
# The largest float accepted, so that no conversion overflows.
LARGEST = 1e9
NEGATIVE = re.compile(r"-[0-9][0-9.eE+-]*")


class MrbtCommand(click.Command):
    """A command of `mrbt`: an InputError in it ends the process with a message and status 2."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        # Click would use the last value and drop the earlier ones.
        _, _, order = self.make_parser(ctx).parse_args(list(args))
        for parameter, count in Counter(order).items():
            if not isinstance(parameter, click.Option) or parameter.is_flag:
                continue
            if count > 1 and not parameter.multiple:
                raise click.UsageError(f"{parameter.opts[0]} is given {count} times.", ctx)
        rest = super().parse_args(ctx, args)
        for parameter in self.params:
            if ctx.params.get(parameter.name or "") == "":
                raise click.BadParameter("it is empty", ctx, parameter)
        return rest

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except InputError as error:
            fail(str(error))
        except BaseExceptionGroup as group:
            # A task group wraps the errors of its tasks.
            alone = lone(group)
            if isinstance(alone, InputError):
                fail(str(alone))
            raise alone from None

    def main(self, *args: Any, **extra: Any) -> NoReturn:
        run(super().main, *args, **extra)


class NumbersCommand(MrbtCommand):
    """A command with arguments that may be negative numbers: `-3` is not taken as an option."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        ctx.ignore_unknown_options = True
        found, _, _ = self.make_parser(ctx).parse_args(list(args))
        arguments = (each for each in self.params if isinstance(each, click.Argument))
        given = [found[each.name] for each in arguments if each.name in found]
        listed = [word for each in given for word in (each if isinstance(each, tuple) else [each])]
        # Click uses a special object for an argument that is not given.
        words = [word for word in listed if isinstance(word, str)]
        # Words after `--` are taken literally.
        literal = args[args.index("--") + 1 :] if "--" in args else []
        for word in words[: len(words) - len(literal)]:
            if word.startswith("-") and word != "-" and not NEGATIVE.fullmatch(word):
                ctx.ignore_unknown_options = False  # click's own message names what is similar
        return super().parse_args(ctx, args)


class CommandGroup(click.Group):
    """A group of subcommands, `mrbt GROUP COMMAND`, listed in the order of their definition."""

    command_class = MrbtCommand

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)


class LateGroup(click.Group):
    """A group whose commands are imported when they are used.

    `sections` maps names that share a row of the help to their purpose. A command is an attribute
    of the module in `mrbt_mesh.cli.commands` that has its name, or that `modules` names. `plugins`
    are commands of other packages; one named `tree.lift` is added to the group `tree`.
    """

    def __init__(
        self,
        sections: Mapping[str, Mapping[str, str]],
        modules: Mapping[str, str],
        plugins: plugins.Group[click.Command],
        **settings: Any,
    ) -> None:
        self._sections, self._modules, self._plugins = sections, modules, plugins
        self._own = [name for rows in sections.values() for row in rows for name in row.split()]
        super().__init__(**settings)

    def list_commands(self, ctx: click.Context) -> list[str]:
        # Only now, since a robot's process does not need the names of plug-ins.
        return [*self._own, *(name for name in self._plugins.names() if "." not in name)]

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        try:
            return super().resolve_command(ctx, args)
        except click.exceptions.NoSuchCommand:
            # Click looks for similar names in `commands` only.
            possible = self.list_commands(ctx)
            raise click.exceptions.NoSuchCommand(args[0], possibilities=possible, ctx=ctx) from None

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name in self._own:
            module = self._modules.get(cmd_name, cmd_name)
            name = f"{cmd_name}_" if keyword.iskeyword(cmd_name) else cmd_name
            found = getattr(importlib.import_module(f"mrbt_mesh.cli.commands.{module}"), name)
            assert isinstance(found, click.Command)
            return found
        return self._plugin(cmd_name) if cmd_name in self.list_commands(ctx) else None

    def _plugin(self, name: str) -> click.Command:
        command = self._plugins.load(name)
        for other in self._plugins.names():
            if other.startswith(f"{name}.") and isinstance(command, click.Group):
                command.add_command(self._plugins.load(other))
        return command

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the sections instead of a list of commands and options."""
        tools = {
            name: self._plugin(name).get_short_help_str(60)
            for name in self.list_commands(ctx)
            if name not in self._own
        }
        sections = {**self._sections, "Tools": tools}
        width = max((len(names) for rows in sections.values() for names in rows), default=0)
        for title, rows in sections.items():
            if rows:
                with formatter.section(title):
                    formatter.write_dl([(f"{names:{width}}", text) for names, text in rows.items()])

    def main(self, *args: Any, **extra: Any) -> NoReturn:
        """Run a command. Called without arguments, this is the program `mrbt`, which ends here."""
        if not args and not extra:
            prepare_streams()
        try:
            run(super().main, *args, **extra)
        except BaseException as error:
            if args or extra or "zenoh" not in sys.modules:
                raise
            if not isinstance(error, SystemExit):
                sys.excepthook(*sys.exc_info())
            end_process(error.code if isinstance(error, SystemExit) else FAILURE)


def run(main: Callable[..., Any], *args: Any, **extra: Any) -> NoReturn:
    """Call click's `main` and end the process. Click's errors are printed like the project's
    own.
    """
    status: Any = SUCCESS
    try:
        try:
            status = main(*args, **{"prog_name": NAME, **extra, "standalone_mode": False})
        except SystemExit as ended:
            status = SUCCESS if ended.code is None else ended.code
        sys.stdout.flush()
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message(), err=True)
        raise SystemExit(error.exit_code) from None
    except click.UsageError as error:
        where = error.ctx.command_path if error.ctx is not None else NAME
        fail(f"{error.format_message()}\nSee {where} --help")
    except click.Abort:
        fail("interrupted", FAILURE)
    except BrokenPipeError:
        # The reader, such as `head`, needs no more.
        drop_output()
        raise SystemExit(FAILURE) from None
    except OutputError as error:
        drop_output()
        code = status if isinstance(status, int) and status != SUCCESS else FAILURE
        fail(f"the output cannot be written: {error.strerror}", code)
    raise SystemExit(status if isinstance(status, int) else SUCCESS)


def fail(message: str, code: int = BAD_INPUT) -> NoReturn:
    """Print a message on stderr and end with an exit status."""
    from mrbt_mesh.cli.terminal import errors, labelled

    errors.print(labelled("error", "bold red", message), soft_wrap=True)
    raise SystemExit(code)


def end_process(code: Any) -> NoReturn:
    """End a process that had a Zenoh session, with the code of a SystemExit.

    Closing a session can take 10 s, and its threads may call Python while the interpreter shuts
    down, which aborts the process.
    """
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError):
            stream.flush()
    os._exit(code if isinstance(code, int) else SUCCESS if code is None else FAILURE)


# -- parameters -------------------------------------------------------------------------------


class FiniteNumber(click.FloatRange):
    """A finite number within bounds."""

    name = "number"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        number = super().convert(value, param, ctx)
        if not abs(number) <= LARGEST:
            self.fail(f"{value}: a number of at most {LARGEST:.0f} is expected", param, ctx)
        return number


class FilePath(click.Path):
    """A path, whether or not it exists."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if not str(value).strip():
            self.fail("it is empty", param, ctx)
        try:
            os.lstat(value)
        except OSError as error:
            if error.errno == errno.ENAMETOOLONG:
                self.fail(f"{value}: the name is too long", param, ctx)
        return super().convert(value, param, ctx)


PATH = FilePath()
PORT = click.IntRange(0, 65_535)


def used(names: Iterable[str] | None = None) -> list[str]:
    """Return the options and arguments that the user gave, as `--seed`, `MISSION`.

    With `names`, only these are considered.
    """
    context = click.get_current_context()
    sources = (ParameterSource.COMMANDLINE, ParameterSource.ENVIRONMENT)
    found = [
        each.opts[0] if isinstance(each, click.Option) else each.human_readable_name.strip("[].")
        for each in context.command.params
        if context.get_parameter_source(each.name or "") in sources
    ]
    return [name for name in found if names is None or name in names]


def refuse(why: str, *names: str) -> None:
    """Raise InputError if one of these options was given; `why` follows their names."""
    found = used(names)
    if found:
        raise InputError(f"{', '.join(found)}: {why}")


Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


def options_as(name: str, kind: type, *options: Decorator) -> Decorator:
    """Combine options into one object for a command: `kind`, a dataclass with a field for each."""
    fields = [field.name for field in dataclasses.fields(kind)]

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def call(*args: Any, **values: Any) -> Any:
            whole = kind(**{field: values.pop(field) for field in fields})
            return function(*args, **values, **{name: whole})

        return with_options(call, options)

    return decorate


def with_options(function: Callable[..., Any], options: Sequence[Decorator]) -> Callable[..., Any]:
    """Decorate the function with all these options, the first one outermost."""
    for option in reversed(options):
        function = option(function)
    return function
