"""The registered functions of a robot's program: their parameters and the types of arguments."""

from __future__ import annotations

import inspect
import os.path
import re
import types
import typing
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from mrbt_mesh.core.mission.names import ALL
from mrbt_mesh.errors import InputError, TaskFailedError
from mrbt_mesh.runtime.context import RobotContext, TaskContext

_TYPES = (int, float, bool, str)
_INTEGER = re.compile(r"[+-]?[0-9]{1,19}", re.ASCII)
_TRUTHS = {"1": True, "true": True, "TRUE": True, "True": True}
_TRUTHS |= {"0": False, "false": False, "FALSE": False, "False": False}
_CONTEXTS = {kind.__name__: kind for kind in (RobotContext, TaskContext)}


class ProgramError(InputError):
    """A robot program cannot be used; the message names the place and the remedy."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter. `type` is what a text is converted to, or the context that it receives."""

    name: str
    type: type
    is_optional: bool = False
    is_keyword: bool = False

    @property
    def is_context(self) -> bool:
        return issubclass(self.type, RobotContext)

    def value(self, text: str) -> Any:
        """Convert an argument in the same way as the ports of a tree's leaves.

        Raises ValueError.
        """
        if self.type is str:
            return text
        try:
            if self.type is bool:
                return _TRUTHS[text]
            if self.type is int and not _INTEGER.fullmatch(text):
                raise ValueError(text)
            return self.type(text)
        except (KeyError, ValueError):
            what = {
                int: "not an integer",
                float: "not a real number",
                bool: "neither true nor false",
            }
            problem = f"the text {text!r} is {what[self.type]}"
            raise ValueError(f"parameter {self.name!r}: {problem}") from None


@dataclass(frozen=True)
class ProgramFunction:
    """Called with a context and texts, it calls `function` with what its parameters ask for.

    `what` names it in messages, `rest` is its `*arguments`, and `code` is the user's own function.
    """

    what: str
    function: Callable[..., Any]
    code: Callable[..., Any]
    parameters: tuple[Parameter, ...] = ()
    rest: Parameter | None = None

    @property
    def __wrapped__(self) -> Callable[..., Any]:
        return self.code

    def __call__(self, context: Any, *texts: str) -> Any:
        """Raises TaskFailedError for arguments that do not fit."""
        try:
            left = self.values(texts)
        except ValueError as error:
            raise TaskFailedError(f"{error} ({os.path.basename(self.place)})") from None
        positional: list[Any] = []
        named: dict[str, Any] = {}
        for each in self.parameters:
            if each.is_context and each.is_keyword:
                named[each.name] = context
            elif each.is_context:
                positional.append(context)
            elif left:
                positional.append(left.pop(0))
        return self.function(*positional, *left, **named)

    @property
    def place(self) -> str:
        """`path/to/robot.py:12`, or its name if its code has no place."""
        code = getattr(_innermost(self.code), "__code__", None)
        return self.what if code is None else f"{code.co_filename}:{code.co_firstlineno}"

    def values(self, texts: Sequence[str]) -> list[Any]:
        """Convert the arguments to the types of the parameters. Raises ValueError."""
        if problem := self.count_problem(len(texts)):
            raise ValueError(f"{problem}, found {len(texts)}")
        named = [each for each in self.parameters if not each.is_context]
        if self.rest is not None:
            named += [self.rest] * (len(texts) - len(named))
        return [each.value(text) for each, text in zip(named, texts, strict=False)]

    def count_problem(self, count: int) -> str:
        """Return why it cannot be called with this number of arguments; empty if it can."""
        named = [each for each in self.parameters if not each.is_context]
        least, most = sum(not each.is_optional for each in named), len(named)
        if least <= count and (self.rest is not None or count <= most):
            return ""
        expected = f"{least}" if least == most else f"{least} to {most}"
        expected = f"at least {least}" if self.rest is not None else expected
        word = "argument" if expected.endswith("1") else "arguments"
        return f"the function takes {expected} {word} besides the context"


def task_function(what: str, target: Any) -> ProgramFunction:
    """Check an async function, or a class with an async method `run`. Raises ProgramError."""
    if not inspect.isclass(target):
        return async_function(what, target)
    new: Callable[[], Any] = target
    run = getattr(target, "run", None)
    if not inspect.iscoroutinefunction(run):
        text = f"the class {target.__name__} needs a method `async def run(self, ...)`"
        raise ProgramError(f"{what}: {text}")
    parameters, rest = _parameters(what, run, is_method=True)

    async def run_instance(*arguments: Any, **named: Any) -> Any:
        return await new().run(*arguments, **named)

    return ProgramFunction(what, run_instance, run, parameters, rest)


def async_function(what: str, target: Any) -> ProgramFunction:
    """Check an async function. Raises ProgramError."""
    checked = any_function(what, target)
    if not inspect.iscoroutinefunction(target):
        name = getattr(target, "__name__", "function")
        raise ProgramError(f"{what}: the function is not async; write `async def {name}(...)`")
    return checked


def any_function(what: str, target: Any) -> ProgramFunction:
    """Check a function, async or not. Raises ProgramError."""
    if not callable(target) or inspect.isclass(target):
        raise ProgramError(f"{what}: {target!r:.80} is not a function")
    return ProgramFunction(what, target, target, *_parameters(what, target))


def travel_function(target: Any) -> ProgramFunction:
    """Check an async function of a place. Raises ProgramError."""
    name = getattr(target, "__name__", repr(target))
    found = async_function(f"travel function {name!r}", target)
    if found.count_problem(1):
        text = f"it is given a place; write `async def {name}(task: TaskContext, place: str)`"
        raise ProgramError(f"{found.what}: {text}")
    return found


def travel_time_function(target: Any) -> ProgramFunction:
    """Check a function, async or not, of two places. Raises ProgramError."""
    name = getattr(target, "__name__", repr(target))
    found = any_function(f"travel time function {name!r}", target)
    if found.count_problem(2):
        text = f"it is given two places; write `def {name}(origin: str, goal: str) -> float`"
        raise ProgramError(f"{found.what}: {text}")
    if any(each.type is TaskContext for each in found.parameters):
        raise ProgramError(f"{found.what}: it belongs to no task; give it a RobotContext instead")
    return found


@dataclass(frozen=True)
class BackgroundFunction:
    """A background function, and the capabilities that the robot loses if it fails."""

    name: str
    function: ProgramFunction
    costs: tuple[str, ...]


def background_function(target: Any, costs: str | Iterable[str]) -> BackgroundFunction:
    """Check an async function that takes only the robot's context. Raises ProgramError."""
    name = getattr(target, "__name__", repr(target))
    found = async_function(f"background function {name!r}", target)
    if found.count_problem(0) or any(each.type is TaskContext for each in found.parameters):
        text = f"it belongs to no task; write `async def {name}(context: RobotContext)`"
        raise ProgramError(f"{found.what}: {text}")
    named: Any = {ALL: [ALL], "none": []}.get(costs) if isinstance(costs, str) else costs
    if not isinstance(named, Iterable) or not all(isinstance(each, str) for each in named):
        text = 'costs is "all", "none", or a list of local tasks, e.g. ["go_to"]'
        raise ProgramError(f"{found.what}: {text}, not {costs!r:.60}")
    return BackgroundFunction(name, found, tuple(named))


def _parameters(
    what: str, function: Any, *, is_method: bool = False
) -> tuple[tuple[Parameter, ...], Parameter | None]:
    """Return the parameters, and `*arguments`. Raises ProgramError."""
    found: list[Parameter] = []
    rest = None
    for each in list(inspect.signature(function).parameters.values())[is_method:]:
        kind = _type(what, function, each)
        has_default = each.default is not inspect.Parameter.empty
        is_keyword = each.kind is inspect.Parameter.KEYWORD_ONLY
        if each.kind is inspect.Parameter.VAR_POSITIONAL:
            rest = Parameter(each.name, kind)
        elif is_keyword and not issubclass(kind, RobotContext):
            if not has_default:
                text = "can only be given by name, but arguments come in order; remove the * before"
                raise ProgramError(f"{what}: parameter {each.name!r} {text}")
        elif each.kind is not inspect.Parameter.VAR_KEYWORD:
            # A context after an optional argument is passed by name.
            is_keyword = is_keyword or any(before.is_optional for before in found)
            found.append(Parameter(each.name, kind, has_default, is_keyword))
    return tuple(found), rest


def _type(what: str, function: Any, parameter: inspect.Parameter) -> type:
    """Return the type to which an argument is converted. Raises ProgramError if it is unknown."""
    annotation, name = parameter.annotation, parameter.name
    if isinstance(annotation, str):
        annotation = annotation.strip("'\"")
        if context := _CONTEXTS.get(annotation.rpartition(".")[2]):
            return context  # even if it is imported only for type checkers
        scope = getattr(_innermost(function), "__globals__", {})
        try:
            # Only this annotation: others may use names imported only for type checkers.
            annotation = eval(annotation, scope)
        except Exception as error:
            problem = f"the annotation of {name!r} cannot be read: {error}"
            raise ProgramError(f"{what}: {problem}") from None
    if typing.get_origin(annotation) in (typing.Union, types.UnionType):
        parts = [part for part in typing.get_args(annotation) if part is not types.NoneType]
        annotation = parts[0] if len(parts) == 1 else annotation
    if annotation is inspect.Parameter.empty and name in ("task", "context"):
        text = f"parameter {name!r} has no annotation; write `{name}: TaskContext` for a context"
        raise ProgramError(f"{what}: {text}")
    if annotation in (inspect.Parameter.empty, Any, object):
        return str
    if annotation in (*_TYPES, *_CONTEXTS.values()):
        return typing.cast(type, annotation)
    raise ProgramError(
        f"{what}: parameter {name!r} is annotated with {parameter.annotation}: an argument is a "
        "text, which becomes an int, float, bool or str"
    )


def _innermost(function: Any) -> Any:
    while isinstance(function, partial):
        function = function.func
    return inspect.unwrap(function)
