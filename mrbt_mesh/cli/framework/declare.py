"""Commands as functions: what a function takes is what its command takes.

    def kill(
        robot: Annotated[str, argument("ROBOT", "A robot's id.")],
        run_dir: Annotated[Path | None, option("Run directory.")] = None,
    ) -> None:
        '''Kill a robot's process.

        Example: mrbt kill A1
        '''

A parameter is named once: `run_dir` is the option `--run-dir`. Its type says what may be given:
str, int, float, bool (a flag), Path, a Literal, or a tuple of one of these where many may be
given. A parameter whose type is a dataclass is a group of options, one for each field, and is
handed over as one object; a group may hold another one. A parameter of the type `Given` is told
which options were used.
"""

from __future__ import annotations

import dataclasses
import inspect
import types
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import click
from click.core import ParameterSource

from mrbt_mesh.cli.framework.command import MrbtCommand
from mrbt_mesh.cli.framework.parameters import Argument, Option
from mrbt_mesh.cli.framework.values import NumberBounds, NumberType, PathType, TextType
from mrbt_mesh.errors import InputError

REQUIRED = inspect.Parameter.empty


@dataclass(frozen=True)
class ParameterDeclaration:
    """What an option or an argument says of itself.

    `name`: `--output`, where it is not the parameter's own; `short`: `-o`; `panel`: where it is
    listed in the help; `variable`: an environment variable that stands for it.
    """

    help: str
    metavar: str | None = None
    name: str | None = None
    short: str | None = None
    panel: str | None = None
    variable: str | None = None
    bounds: NumberBounds = field(default_factory=NumberBounds)
    is_argument: bool = False


def option(
    text: str,
    metavar: str | None = None,
    *,
    name: str | None = None,
    short: str | None = None,
    panel: str | None = None,
    variable: str | None = None,
    **bounds: float,
) -> ParameterDeclaration:
    """An option; for the keywords see `ParameterDeclaration` and `NumberBounds`."""
    return ParameterDeclaration(text, metavar, name, short, panel, variable, NumberBounds(**bounds))


def argument(metavar: str, text: str) -> ParameterDeclaration:
    """An argument without a name."""
    return ParameterDeclaration(text, metavar, is_argument=True)


@dataclass(frozen=True)
class Given:
    """The options and arguments that were used, as they are written: `--seed`, `MISSION`."""

    names: tuple[str, ...]

    def refuse(self, names: Iterable[str], why: str) -> None:
        """Raise InputError if one of `names` was used; `why` goes on after their names."""
        unwanted = set(names)
        found = [name for name in self.names if name in unwanted]
        if found:
            raise InputError(f"{', '.join(found)}: {why}")

    def refuse_all_but(self, names: Iterable[str], why: str) -> None:
        """Raise InputError if anything but `names` was used."""
        self.refuse({*self.names} - {*names}, why)


def command(function: Callable[..., None]) -> MrbtCommand:
    """The click command of a function.

    Raises TypeError for parameters that cannot be declared, e.g. of the same name in two groups.
    """
    hints = get_type_hints(function, include_extras=True)
    taken = inspect.signature(function).parameters
    parameters: list[click.Parameter] = []
    for name, parameter in taken.items():
        if dataclasses.is_dataclass(hints[name]) and hints[name] is not Given:
            parameters += _group(hints[name])
        elif hints[name] is not Given:
            parameters.append(_parameter(name, hints[name], parameter.default))
    names = [parameter.name for parameter in parameters]
    if len(set(names)) < len(names):
        raise TypeError(f"{function.__name__}: two parameters of the same name: {names}")

    def call(**values: Any) -> None:
        function(**{name: _value(name, hints[name], values) for name in taken})

    return MrbtCommand(function.__name__, params=parameters, help=function.__doc__, callback=call)


def _group(group: Any) -> list[click.Parameter]:
    hints = get_type_hints(group, include_extras=True)
    found: list[click.Parameter] = []
    for part in dataclasses.fields(group):
        default = REQUIRED if part.default is dataclasses.MISSING else part.default
        if dataclasses.is_dataclass(hints[part.name]):
            found += _group(hints[part.name])
        else:
            found.append(_parameter(part.name, hints[part.name], default))
    return found


def _value(name: str, hint: Any, values: dict[str, Any]) -> Any:
    """What a parameter of the function is given."""
    if hint is Given:
        return _given(click.get_current_context())
    if isinstance(hint, type) and dataclasses.is_dataclass(hint):
        hints = get_type_hints(hint, include_extras=True)
        parts = [part.name for part in dataclasses.fields(hint)]
        return hint(**{part: _value(part, hints[part], values) for part in parts})
    return values[name]


def _given(context: click.Context) -> Given:
    used = (ParameterSource.COMMANDLINE, ParameterSource.ENVIRONMENT)
    return Given(
        tuple(
            parameter.opts[0] if isinstance(parameter, Option) else parameter.human_readable_name
            for parameter in context.command.params
            if parameter.name and context.get_parameter_source(parameter.name) in used
        )
    )


def _parameter(name: str, hint: Any, default: Any) -> click.Parameter:
    """One option or argument; raises TypeError where its type cannot be given in a command."""
    if get_origin(hint) is not Annotated:
        raise TypeError(f"{name}: not declared as an option or an argument")
    kind, declared = get_args(hint)
    if get_origin(kind) in (Union, types.UnionType):
        (kind,) = (part for part in get_args(kind) if part is not types.NoneType)
    is_many = get_origin(kind) is tuple
    if is_many:
        kind = get_args(kind)[0]
    settings: dict[str, Any] = {"required": default is REQUIRED}
    if default is not REQUIRED and default not in (None, ()):
        settings["default"] = default
    if declared.is_argument:
        settings |= {"nargs": -1 if is_many else 1, "metavar": declared.metavar}
        return Argument(name, declared.help, type=_type(name, kind, declared), **settings)
    long = declared.name or f"--{name.replace('_', '-')}"
    declarations = [name, long, *([declared.short] if declared.short else [])]
    settings |= {"help": declared.help, "panel": declared.panel, "envvar": declared.variable}
    if kind is bool:
        return Option(declarations, is_flag=True, **settings)
    settings |= {"multiple": is_many, "metavar": declared.metavar, "show_default": True}
    return Option(declarations, type=_type(name, kind, declared), **settings)


def _type(name: str, kind: Any, declared: ParameterDeclaration) -> click.ParamType[Any]:
    if kind in (int, float):
        return NumberType(kind, declared.bounds)
    if kind is str:
        return TextType()
    if kind is Path:
        return PathType()
    if get_origin(kind) is Literal:
        return click.Choice(get_args(kind))
    raise TypeError(f"{name}: a command cannot take a value of the type {kind}")
