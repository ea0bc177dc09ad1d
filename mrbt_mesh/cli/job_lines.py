"""Many jobs at once: a JSON object per line, all checked first, then handed in side by side."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from typing import IO, TYPE_CHECKING, Any

import anyio

from mrbt_mesh.cli.job_times import passed_text, time_of, times_problem, understood
from mrbt_mesh.errors import InputError, nearest
from mrbt_mesh.formats.json_text import bounded_whole, without_doubles

if TYPE_CHECKING:
    from mrbt_mesh.runtime.team_client import TeamClient

# As many jobs as a team has open at most, and what a line of one may hold.
MAX_LINES, MAX_LINE_BYTES = 20_000, 65_536
# Problems of lines that are listed.
MOST_LISTED = 20
# Jobs that are handed in side by side.
AT_ONCE = 16
KEYS = ("type", "arguments", "id", "priority", "not_before", "deadline", "safe")
NOT_ANSWERED = "not_answered"


@dataclass(frozen=True, kw_only=True)
class JobLine:
    """A job of a line. `arguments`: in order, or by the names of the type's parameters.

    `notes`: what is to be said of it.
    """

    number: int
    type: str
    arguments: Sequence[Any] | dict[str, Any] = ()
    id: str = ""
    priority: int | None = None
    not_before: datetime | timedelta | None = None
    deadline: datetime | timedelta | None = None
    safe: int | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Result:
    """What became of a line: a state, or a problem and its cause."""

    line: JobLine
    state: str = ""
    problem: str = ""
    cause: str = ""

    def data(self) -> dict[str, Any]:
        """As plain data."""
        at = understood(not_before=self.line.not_before, deadline=self.line.deadline)
        found = {"line": self.line.number, "id": self.line.id, **at}
        if self.problem:
            return found | {"problem": self.problem, "cause": self.cause}
        return found | {"state": self.state}

    def text(self) -> str:
        """For people: the id, or what is wrong."""
        if self.problem:
            problem = self.problem.removeprefix(f"{self.line.id}: ")
            return f"line {self.line.number}: {self.line.id}: {problem}"
        return self.line.id


class Problems:
    """What is wrong with lines, by their numbers."""

    def __init__(self) -> None:
        self._found: dict[int, str] = {}

    def add(self, number: int, problem: object) -> None:
        self._found.setdefault(number, str(problem))

    def check(self) -> None:
        """Raise InputError if there are any."""
        if not self._found:
            return
        rows = [f"line {number}: {self._found[number]}" for number in sorted(self._found)]
        if len(rows) > MOST_LISTED:
            rows[MOST_LISTED:] = [f"and {len(rows) - MOST_LISTED} more lines are wrong"]
        raise InputError("\n".join([*rows, "no job was submitted"]))


def read_lines(stream: IO[bytes], problems: Problems) -> list[JobLine]:
    """The jobs of all lines that are not blank; adds to `problems` those that are none.

    Raises InputError where there is no job, or too many.
    """
    found: list[JobLine] = []
    count = number = 0
    while line := stream.readline(MAX_LINE_BYTES + 1):
        number += 1
        if len(line) > MAX_LINE_BYTES:
            problems.add(number, f"longer than {MAX_LINE_BYTES} bytes")
            return found
        if not line.strip():
            continue
        count += 1
        if count > MAX_LINES:
            raise InputError(f"more than {MAX_LINES} jobs; submit them in parts")
        try:
            found.append(_job_of(line, number))
        except ValueError as error:
            problems.add(number, error)
    if not count:
        raise InputError(
            'standard input has no job; one per line is expected: {"type": "deliver", '
            '"arguments": ["shelf_2"]}'
        )
    return found


def _job_of(line: bytes, number: int) -> JobLine:
    """The job of a line; raises ValueError."""
    data = _object_in(line)
    for key in data:
        if key not in KEYS:
            raise ValueError(f"no key {key!r:.80}{nearest(key, KEYS)}")
    values = {key: value for key, value in data.items() if value is not None}
    for key, (expected, accepts) in _EXPECTED.items():
        if key in values and not accepts(values[key]):
            raise ValueError(f"{key} is {expected}")
    if "type" not in values:
        raise ValueError("no type is given")
    notes = []
    for key in ("not_before", "deadline"):
        if (text := values.get(key)) is None:
            continue
        try:
            values[key], has_passed = time_of(text)
        except ValueError as error:
            raise ValueError(f"{key}: {error}") from None
        if has_passed and key == "not_before":
            notes.append(passed_text(text))
    return JobLine(number=number, notes=tuple(notes), **values)


def _object_in(line: bytes) -> dict[str, Any]:
    """The JSON object of a line; raises ValueError."""
    try:
        # Some programs begin a file with a mark of its encoding.
        text = line.decode("utf-8-sig")
        data = json.loads(text, object_pairs_hook=without_doubles, parse_int=bounded_whole)
    except UnicodeDecodeError:
        raise ValueError("not in UTF-8") from None
    except (json.JSONDecodeError, RecursionError) as error:
        raise ValueError(f"no JSON: {error}") from None
    if not isinstance(data, dict):
        raise ValueError('a JSON object is expected, e.g. {"type": "deliver", "arguments": []}')
    return data


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _are_arguments(value: Any) -> bool:
    """What is in them is judged by the type of the job."""
    return isinstance(value, list | dict)


_EXPECTED: dict[str, tuple[str, Callable[[Any], bool]]] = {
    "type": ("a text", _is_text),
    "arguments": ("a list or an object", _are_arguments),
    "id": ("a text", _is_text),
    "priority": ("a whole number", _is_whole),
    "not_before": ("a text", _is_text),
    "deadline": ("a text", _is_text),
    "safe": ("a whole number from 1 on", lambda value: _is_whole(value) and value >= 1),
}


def checked(
    client: TeamClient, lines: Iterable[JobLine], safe: int | None, problems: Problems
) -> list[JobLine]:
    """The jobs with their arguments in order, and with ids; adds to `problems` what the team's
    mission does not have. `safe`: for lines that say nothing.
    """
    from mrbt_mesh.runtime.job_requests import JobRefusedError
    from mrbt_mesh.runtime.team_client import new_job_id

    found, by_id = [], dict[str, int]()
    for line in lines:
        wanted = line.safe if line.safe is not None else safe
        try:
            arguments = client.arguments_of(line.type, line.arguments)
            name = line.id or new_job_id()
            kind = client.check_job(line.type, arguments, name, line.priority, wanted)
            if problem := kind.problem(arguments) or times_problem(line.not_before, line.deadline):
                raise JobRefusedError(problem)
        except JobRefusedError as error:
            problems.add(line.number, error)
            continue
        if (first := by_id.setdefault(name, line.number)) != line.number:
            problems.add(line.number, f"the id {name} is that of line {first}")
        found.append(replace(line, arguments=arguments, id=name, safe=wanted))
    return found


async def hand_in(
    client: TeamClient, lines: Sequence[JobLine], show: Callable[[Result], None]
) -> bool:
    """Hand in jobs, several at once, and show what became of each in their order; whether the team
    has taken them all. Output that cannot be written keeps no job from being handed in: OSError
    afterwards.
    """
    from mrbt_mesh.runtime.job_requests import JobRefusedError
    from mrbt_mesh.runtime.team_client import NOBODY_HEARD

    results: dict[int, Result] = {}
    waiting, shown = iter(enumerate(lines)), 0
    has_silence, lost = False, list[OSError]()

    async def one(line: JobLine) -> Result:
        nonlocal has_silence
        if has_silence and not client.robots:
            return Result(line, problem=NOBODY_HEARD, cause=NOT_ANSWERED)
        try:
            job = await client.submit(
                line.type,
                arguments=line.arguments,
                job_id=line.id,
                priority=line.priority,
                not_before=line.not_before,
                deadline=line.deadline,
                safe=line.safe,
            )
        except JobRefusedError as error:
            return Result(line, problem=str(error), cause=error.cause)
        except TimeoutError as error:
            has_silence = True
            return Result(line, problem=str(error), cause=NOT_ANSWERED)
        return Result(line, job.state)

    async def work() -> None:
        nonlocal shown
        for index, line in waiting:
            results[index] = await one(line)
            while shown in results:
                try:
                    if not lost:
                        show(results[shown])
                except OSError as error:
                    lost.append(error)
                shown += 1

    async with anyio.create_task_group() as group:
        for _ in range(min(AT_ONCE, len(lines))):
            group.start_soon(work)
    if lost:
        raise lost[0]
    return not any(result.problem for result in results.values())
