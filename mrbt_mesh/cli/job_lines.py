"""Submit many jobs at once: one JSON object per line; all are checked first."""

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

# The most jobs that a team has open, and the longest line.
MAX_LINES, MAX_LINE_BYTES = 20_000, 65_536
# The most problems of lines that are listed.
MOST_LISTED = 20
# Jobs that are submitted at the same time.
AT_ONCE = 16
KEYS = ("type", "arguments", "id", "priority", "not_before", "deadline", "safe")
NOT_ANSWERED = "not_answered"


@dataclass(frozen=True, kw_only=True)
class JobLine:
    """A job of a line. `arguments` are in order, or by the names of the type's parameters.

    `notes` are printed for people.
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
    """The result for a line: a state, or a problem and its cause."""

    line: JobLine
    state: str = ""
    problem: str = ""
    cause: str = ""

    def data(self) -> dict[str, Any]:
        """Return plain data."""
        at = understood(not_before=self.line.not_before, deadline=self.line.deadline)
        found = {"line": self.line.number, "id": self.line.id, **at}
        if self.problem:
            return found | {"problem": self.problem, "cause": self.cause}
        return found | {"state": self.state}

    def text(self) -> str:
        """Return the id, or what is wrong, for people."""
        if self.problem:
            problem = self.problem.removeprefix(f"{self.line.id}: ")
            return f"line {self.line.number}: {self.line.id}: {problem}"
        return self.line.id


class Problems:
    """The problems of lines, by line number."""

    def __init__(self) -> None:
        self._found: dict[int, str] = {}

    def add(self, number: int, problem: object) -> None:
        self._found.setdefault(number, str(problem))

    def check(self) -> None:
        """Raise InputError if there are any problems."""
        if not self._found:
            return
        rows = [f"line {number}: {self._found[number]}" for number in sorted(self._found)]
        if len(rows) > MOST_LISTED:
            rows[MOST_LISTED:] = [f"and {len(rows) - MOST_LISTED} more lines are wrong"]
        raise InputError("\n".join([*rows, "no job was submitted"]))


def read_lines(stream: IO[bytes], problems: Problems) -> list[JobLine]:
    """Return the jobs of all lines that are not blank; invalid lines are added to `problems`.

    Raises InputError if there is no job, or there are too many.
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
    """Return the job of a line; raises ValueError."""
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
    """Return the JSON object of a line; raises ValueError."""
    try:
        # Some programs write a byte order mark first.
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
    """Accept any list or object; the job's type judges its content."""
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
    """Return the jobs with ids and with their arguments in order.

    Adds jobs that the team's mission does not allow to `problems`. `safe` applies to lines without
    it.
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
    """Submit jobs, several at once, and show the result of each in their order.

    Returns whether the team has accepted all. If results cannot be written, all jobs are submitted
    nevertheless; OSError is raised afterwards.
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
