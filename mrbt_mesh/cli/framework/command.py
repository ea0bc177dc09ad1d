"""Our kind of click command: its help screen, and what it says of wrong input."""

from __future__ import annotations

import os
import sys
from collections import Counter
from collections.abc import Callable
from typing import Any, NoReturn

import click

from mrbt_mesh.cli.framework.exits import FAILURE, SUCCESS, fail
from mrbt_mesh.errors import InputError

NAME = "mrbt"


class MrbtCommand(click.Command):
    """One command. Wrong input in it, an InputError, is told as a message with status 2."""

    def get_help(self, ctx: click.Context) -> str:
        from mrbt_mesh.cli.framework.help_screen import command_help

        return command_help(self, ctx)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        # Click takes the last one and drops the others.
        _, _, order = self.make_parser(ctx).parse_args(list(args))
        options = [p for p in order if isinstance(p, click.Option)]
        for parameter, count in Counter(options).items():
            if count > 1 and not parameter.multiple and not parameter.is_flag:
                raise click.UsageError(f"{parameter.opts[0]} is given {count} times.", ctx)
        return super().parse_args(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except InputError as error:
            fail(str(error))
        except BaseExceptionGroup as group:
            # A task group wraps what was raised within it.
            alone = lone(group)
            if isinstance(alone, InputError):
                fail(str(alone))
            raise alone from None

    def main(self, *args: Any, **extra: Any) -> Any:
        run(super().main, *args, **extra)


def lone(error: BaseException) -> BaseException:
    """The one exception in a group of one; a group of several stays one."""
    while isinstance(error, BaseExceptionGroup) and len(error.exceptions) == 1:
        error = error.exceptions[0]
    return error


def run(main: Callable[..., Any], *args: Any, **extra: Any) -> NoReturn:
    """Call click's `main` and end the process; what click refuses becomes a message like ours."""
    try:
        status = main(*args, **{"prog_name": NAME, **extra, "standalone_mode": False})
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
        # Whoever reads it, `head` for one, has seen enough; Python's own last flush would fail too.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(FAILURE) from None
    raise SystemExit(status if isinstance(status, int) else SUCCESS)
