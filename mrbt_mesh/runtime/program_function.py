"""A registered function of a robot's program: what it takes, checked, and its arguments' types."""

from __future__ import annotations

import inspect
import os.path
import re
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from mrbt_mesh.core.mission.names import ALL
from mrbt_mesh.errors import InputError, TaskFailedError

_POSITIONAL = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
_TYPES = (int, float, bool, str)
_INTEGER = re.compile(r"[+-]?[0-9]{1,19}", re.ASCII)
_TRUTHS = {"1": True, "true": True, "TRUE": True, "True": True}
_TRUTHS |= {"0": False, "false": False, "FALSE": False, "False": False}


class ProgramError(InputError):
    """A robot program that cannot be used; the message says where and what would be right."""


@dataclass(frozen=True, slots=True)
class TaskParameter:
    """A parameter behind the context; `type` is what an argument, a text, is converted to."""

    name: str
    type: type
    is_optional: bool = False


@dataclass(frozen=True)
class ProgramFunction:
    """Called with a context and texts, it calls `function` with the context and typed values.

    `rest`: its `*arguments`. `code` is the user's own
    function, for places in messages.
    """

    what: str
    function: Callable[..., Any]
    code: Callable[..., Any]
    parameters: tuple[TaskParameter, ...] = ()
    rest: TaskParameter | None = None

    @property
    def __wrapped__(self) -> Callable[..., Any]:
        return self.code

    def __call__(self, task: Any, *texts: str) -> Any:
        """Raises TaskFailedError for arguments that do not fit."""
        try:
            values = self.values(texts)
        except ValueError as error:
            raise TaskFailedError(f"{error} ({os.path.basename(self.place)})") from None
        return self.function(task, *values)

    @property
    def place(self) -> str:
        """`path/to/robot.py:12`, or its name where it has no place."""
        code = getattr(_innermost(self.code), "__code__", None)
        return self.what if code is None else f"{code.co_filename}:{code.co_firstlineno}"

    def values(self, texts: Sequence[str]) -> list[Any]:
        """The arguments by the types of the parameters. Raises ValueError."""
        if problem := self.count_problem(len(texts)):
            raise ValueError(f"{problem}, found {len(texts)}")
        return [_value(each, text) for each, text in zip(self._each(), texts, strict=False)]

    def count_problem(self, count: int) -> str:
        """Why it cannot be called with so many arguments; empty if it can."""
        least = sum(not each.is_optional for each in self.parameters)
        most = len(self.parameters)
        if least <= count and (self.rest is not None or count <= most):
            return ""
        expected = f"{least}" if least == most else f"{least} to {most}"
        expected = f"at least {least}" if self.rest is not None else expected
        word = "argument" if expected.endswith("1") else "arguments"
        return f"the function takes {expected} {word} besides the task"

    def _each(self) -> Iterator[TaskParameter]:
        yield from self.parameters
        while self.rest is not None:
            yield self.rest


def task_function(what: str, target: Any) -> ProgramFunction:
    """An async function `f(task, ...)` or a class with such a method `run`. Raises ProgramError."""
    if not inspect.isclass(target):
        return async_function(what, target)
    new: Callable[[], Any] = target
    run = getattr(target, "run", None)
    if not inspect.iscoroutinefunction(run):
        text = f"the class {target.__name__} needs a method `async def run(self, task, ...)`"
        raise ProgramError(f"{what}: {text}")
    parameters, rest = _parameters(what, run, is_method=True)

    async def run_instance(task: Any, *arguments: Any) -> Any:
        return await new().run(task, *arguments)

    return ProgramFunction(what, run_instance, run, parameters, rest)


def async_function(what: str, target: Any) -> ProgramFunction:
    """An async function `f(task, ...)`. Raises ProgramError."""
    checked = any_function(what, target)
    if not inspect.iscoroutinefunction(target):
        name = getattr(target, "__name__", "function")
        raise ProgramError(f"{what}: the function is not async; write `async def {name}(...)`")
    return checked


def any_function(what: str, target: Any) -> ProgramFunction:
    """A function `f(task, ...)`, async or not. Raises ProgramError."""
    if not callable(target) or inspect.isclass(target):
        raise ProgramError(f"{what}: {target!r:.80} is not a function")
    parameters, rest = _parameters(what, target)
    return ProgramFunction(what, target, target, parameters, rest)


@dataclass(frozen=True)
class BackgroundFunction:
    """A function of the context alone, and the capabilities that the robot loses if it fails."""

    function: Callable[[Any], Any]
    costs: tuple[str, ...]

    @property
    def name(self) -> str:
        return str(getattr(self.function, "__name__", repr(self.function)))


def background_function(target: Any, costs: str | Iterable[str]) -> BackgroundFunction:
    """An async function of the context alone, and what it costs. Raises ProgramError."""
    name = getattr(target, "__name__", repr(target))
    found = async_function(f"background function {name!r}", target)
    if found.count_problem(0):
        text = f"write `async def {name}(task: TaskContext)`"
        raise ProgramError(f"{found.what}: it is called with the task alone; {text}")
    named: Any = {ALL: [ALL], "none": []}.get(costs) if isinstance(costs, str) else costs
    if not isinstance(named, Iterable) or not all(isinstance(each, str) for each in named):
        text = 'costs is "all", "none", or a list of local tasks, as ["go_to"]'
        raise ProgramError(f"{found.what}: {text}, not {costs!r:.60}")
    return BackgroundFunction(target, tuple(named))


def checked_name(decorator: str, name: Any) -> str:
    """The name that a decorator was given. Raises ProgramError for `@robot.local_task` alone."""
    if isinstance(name, str) and name:
        return name
    example = getattr(name, "__name__", "NAME")
    raise ProgramError(f'@robot.{decorator} needs a name: write @robot.{decorator}("{example}")')


def _parameters(
    what: str, function: Any, *, is_method: bool = False
) -> tuple[tuple[TaskParameter, ...], TaskParameter | None]:
    """What follows the context, and `*arguments`. Raises ProgramError."""
    given = list(inspect.signature(function).parameters.values())[is_method:]
    name = getattr(function, "__name__", "function")
    if not given or given[0].kind not in (*_POSITIONAL, inspect.Parameter.VAR_POSITIONAL):
        wanted = "self, task: TaskContext" if is_method else "task: TaskContext"
        raise ProgramError(f"{what}: it has no parameter for the task; write {name}({wanted}, ...)")
    takes_rest = given[0].kind is inspect.Parameter.VAR_POSITIONAL
    first, *others = given
    if not takes_rest and first.annotation in (*_TYPES, *(each.__name__ for each in _TYPES)):
        text = f"the first parameter gets the task; write {name}(task: TaskContext, {first.name})"
        raise ProgramError(f"{what}: {text}")
    found: list[TaskParameter] = []
    rest = TaskParameter(first.name, str) if takes_rest else None
    for each in others:
        has_default = each.default is not inspect.Parameter.empty
        if each.kind in _POSITIONAL:
            found.append(TaskParameter(each.name, _type(what, function, each), has_default))
        elif each.kind is inspect.Parameter.VAR_POSITIONAL:
            rest = TaskParameter(each.name, _type(what, function, each))
        elif each.kind is inspect.Parameter.KEYWORD_ONLY and not has_default:
            text = "can only be given by name, but arguments come in order"
            raise ProgramError(f"{what}: parameter {each.name!r} {text}; remove the * before it")
    return tuple(found), rest


def _type(what: str, function: Any, parameter: inspect.Parameter) -> type:
    """The type to which an argument is converted. Raises ProgramError for one that is unknown."""
    annotation = parameter.annotation
    if isinstance(annotation, str):
        scope = getattr(_innermost(function), "__globals__", {})
        try:
            # Only this one: others may name what is imported for type checkers alone.
            annotation = eval(annotation, scope)
        except Exception as error:
            problem = f"the annotation of {parameter.name!r} cannot be read: {error}"
            raise ProgramError(f"{what}: {problem}") from None
    if typing.get_origin(annotation) in (typing.Union, types.UnionType):
        parts = [part for part in typing.get_args(annotation) if part is not types.NoneType]
        annotation = parts[0] if len(parts) == 1 else annotation
    if annotation in (inspect.Parameter.empty, Any, object):
        return str
    if annotation in _TYPES:
        return typing.cast(type, annotation)
    text = f"parameter {parameter.name!r} is annotated with {parameter.annotation}"
    raise ProgramError(
        f"{what}: {text}: an argument is a text, which becomes an int, float, bool or str"
    )


def _value(parameter: TaskParameter, text: str) -> Any:
    """An argument, converted as the ports of a tree's leaves are. Raises ValueError."""
    if parameter.type is str:
        return text
    try:
        if parameter.type is bool:
            return _TRUTHS[text]
        if parameter.type is int and not _INTEGER.fullmatch(text):
            raise ValueError(text)
        return parameter.type(text)
    except (KeyError, ValueError):
        what = {int: "no integer", float: "no real number", bool: "neither true nor false"}
        problem = f"the text {text!r} is {what[parameter.type]}"
        raise ValueError(f"parameter {parameter.name!r}: {problem}") from None


def _innermost(function: Any) -> Any:
    while isinstance(function, partial):
        function = function.func
    return inspect.unwrap(function)
