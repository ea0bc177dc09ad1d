"""Arguments of jobs: what people and programs give becomes ordered texts, as facts have them; and
what facts have is shown as values with names.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

from mrbt_mesh.core.mission.mission import JobParameter, JobType, is_whole_number, whole

Argument: TypeAlias = str | int
Arguments: TypeAlias = Sequence[Argument] | Mapping[str, Argument]

# Of larger numbers programs that read JSON lose digits.
MAX_EXACT = (1 << 53) - 1
_NUMBER = re.compile(r"0|-?[1-9][0-9]{0,15}")


def ordered_arguments(kind: JobType, given: Arguments) -> list[str]:
    """The arguments of a job, in the order of the type's parameters, from values by position or by
    the parameters' names. A number and its text are the same.

    Raises ValueError for another number of values, for other names, and for values that are
    neither texts nor whole numbers. What texts fit is for `JobType.problem`.
    """
    parameters = kind.parameters
    if isinstance(given, Mapping):
        names = [each.name for each in parameters]
        if set(given) != set(names):
            said = ", ".join(map(str, given)) or "none"
            wanted = ", ".join(names) or "none"
            raise ValueError(f"{kind.name} takes the arguments {wanted}; given: {said:.200}")
        values: list[Any] = [given[name] for name in names]
    elif isinstance(given, Sequence) and not isinstance(given, str | bytes):
        values = list(given)
        if len(values) != len(parameters):
            wanted = kind.problem([""] * len(values))  # as robots say it
            raise ValueError(f"{wanted}; given: {len(values)}")
    else:
        raise ValueError("arguments are values in order, or by the names of parameters")
    pairs = zip(parameters, values, strict=True)
    return [_text(parameter, whole(value)) for parameter, value in pairs]


def named_arguments(
    types: Mapping[str, JobType], kind: str, arguments: Sequence[str]
) -> dict[str, Argument]:
    """Parameter -> argument of a job, a number where the parameter is one; of a type that the
    mission lacks, the numbers of both.
    """
    known = types.get(kind)
    if known is None or len(known.parameters) != len(arguments):
        return {str(number): value for number, value in enumerate(arguments, 1)}
    pairs = zip(known.parameters, arguments, strict=True)
    return {each.name: _value(each, argument) for each, argument in pairs}


def is_exact_number(text: str) -> bool:
    """Whether a number given as an argument can become this text."""
    return _NUMBER.fullmatch(text) is not None and abs(int(text)) <= MAX_EXACT


def _text(parameter: JobParameter, value: Any) -> str:
    """A value as a text; raises ValueError, with what would be right."""
    if isinstance(value, str):
        return str.__str__(value)  # of an enum of texts, too
    wanted = parameter.problem("")
    if isinstance(value, bool) or not isinstance(value, int):
        raise ValueError(f"{wanted}; {_shown(value)} is neither a text nor a whole number")
    if abs(value) > MAX_EXACT:
        raise ValueError(f"{parameter.name}: the number has too many digits; {wanted}")
    return str(int(value))


def _value(parameter: JobParameter, argument: str) -> Argument:
    is_number = not parameter.choices and is_whole_number(argument)
    return int(argument) if is_number else argument


def _shown(value: Any) -> str:
    """A value that is no argument, in the words of JSON."""
    if value is None:
        return "null"
    if isinstance(value, bool | float):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return "a list"
    return "an object" if isinstance(value, dict) else f"a value of type {type(value).__name__}"
