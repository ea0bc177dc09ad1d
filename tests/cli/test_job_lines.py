"""Many jobs from lines of JSON."""

from __future__ import annotations

import io
import json
from datetime import timedelta
from typing import Any

import anyio
import pytest

from mrbt_mesh.cli import job_lines
from mrbt_mesh.cli.job_lines import JobLine, Problems, Result, checked, hand_in, read_lines
from mrbt_mesh.errors import InputError
from tests.support.one_robot import DeskClient


def read(*lines: object) -> list[JobLine]:
    """The jobs of lines of JSON, or of bytes, as the team of deliveries takes them."""
    data = [each if isinstance(each, bytes) else json.dumps(each).encode() for each in lines]
    problems = Problems()
    found = read_lines(io.BytesIO(b"\n".join(data)), problems)
    jobs = checked(DeskClient(), found, None, problems)
    problems.check()
    return jobs


def test_a_job_is_what_its_line_says() -> None:
    by_name = {"shelf": "shelf_1", "dock": "dock_2", "boxes": 3}
    first, second = read(
        {"type": "deliver", "arguments": by_name, "id": "a", "priority": 3, "safe": 2},
        b"",
        {"type": "inspect", "arguments": ["shelf_2"], "deadline": "+60", "id": None},
    )
    assert first == JobLine(
        number=1,
        type="deliver",
        arguments=["shelf_1", "dock_2", "3"],
        id="a",
        priority=3,
        safe=2,
    )
    assert (second.number, second.deadline, bool(second.id)) == (3, timedelta(seconds=60), True)


INSPECT = {"type": "inspect", "arguments": ["shelf_1"]}


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (b"{", "no JSON: "),
        (b"[" * 60_000, "no JSON: "),
        (b"\xff", "not in UTF-8"),
        (b'{"type": "inspect", "type": "paint"}', "'type' is given twice"),
        (b'{"type": "inspect", "priority": ' + b"1" * 5000 + b"}", "a number of 5000 digits"),
        ({**INSPECT, "deadline": "+0"}, "its deadline has passed; give a later one"),
        (
            {**INSPECT, "deadline": "+5", "not_before": "+6"},
            "its deadline is before the time at which it may begin",
        ),
        ({**INSPECT, "deadline": "2001-01-01T00:00Z"}, "its deadline has passed"),
        (b" " * 70_000 + b"{}", "longer than 65536 bytes"),
        ([], "a JSON object is expected"),
        ({"typ": "inspect"}, "no key 'typ'; did you mean 'type'?"),
        ({"arguments": []}, "no type is given"),
        ({"type": 3}, "type is a text"),
        ({"type": "inspect", "arguments": "shelf_1"}, "arguments is a list or an object"),
        ({"type": "inspect", "arguments": [True]}, "where is one of dock_1"),
        ({"type": "inspect", "arguments": {"where": 1.5}}, "where is one of dock_1"),
        ({"type": "inspect", "priority": "high"}, "priority is a whole number"),
        ({"type": "inspect", "safe": 0}, "safe is a whole number from 1 on"),
        ({"type": "inspect", "deadline": "soon"}, "deadline: 'soon' is not a time: +600"),
        ({"type": "inspect", "deadline": "+1e9"}, "deadline: +1e9: at most +31622400"),
        ({"type": "paint"}, "no job type 'paint'"),
        ({"type": "inspect"}, "inspect takes 1 argument (where); given: 0"),
        ({"type": "inspect", "arguments": ["moon"]}, "where is one of "),
        ({"type": "inspect", "arguments": {"what": "moon"}}, "inspect takes the arguments where"),
        ({"type": "inspect", "arguments": ["shelf_1"], "id": ".."}, "'..' is not an id"),
        ({"type": "inspect", "arguments": ["shelf_1"], "id": "\ud800"}, "is not an id"),
        ({"type": "inspect", "arguments": ["shelf_1"], "priority": 10**9}, "a priority is"),
        ({"type": "inspect", "arguments": ["shelf_1"], "safe": 99}, "safe 99: the mission has"),
        ({"type": "inspect", "arguments": ["shelf_1"], "id": "good"}, "the id good is that of"),
    ],
)
def test_a_wrong_line_is_refused_with_its_number(line: object, message: str) -> None:
    good = {"type": "inspect", "arguments": ["shelf_1"], "id": "good"}
    with pytest.raises(InputError) as error:
        read(good, b"", line)
    first, last = str(error.value).split("\n")
    assert first.startswith(f"line 3: {message}" if "is not an id" not in message else "line 3: ")
    assert message in first
    assert last == "no job was submitted"


def test_a_mark_of_the_encoding_is_no_part_of_the_first_line() -> None:
    (job,) = read(b"\xef\xbb\xbf" + json.dumps(INSPECT).encode())
    assert job.type == "inspect"


def test_an_id_is_said_once() -> None:
    line = JobLine(number=3, type="inspect", id="one")
    assert (
        Result(line, problem="one: nothing was written").text()
        == "line 3: one: nothing was written"
    )


def test_all_wrong_lines_are_said_up_to_a_limit() -> None:
    with pytest.raises(InputError) as error:
        read(*[{}] * 30)
    lines = str(error.value).split("\n")
    assert lines[0] == "line 1: no type is given"
    assert lines[-2:] == ["and 10 more lines are wrong", "no job was submitted"]


def test_input_without_a_job_or_with_too_many_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="standard input has no job"):
        read(b"\n \n")
    monkeypatch.setattr(job_lines, "MAX_LINES", 2)
    with pytest.raises(InputError, match="more than 2 jobs"):
        read({}, {}, {})


def lines_of(*names: str, **more: Any) -> list[JobLine]:
    return [
        JobLine(number=number, type="inspect", arguments=["shelf_1"], id=name, **more)
        for number, name in enumerate(names, 1)
    ]


def handed_in(client: DeskClient, lines: list[JobLine]) -> tuple[bool, list[Result]]:
    results: list[Result] = []
    good = anyio.run(hand_in, client, lines, results.append)
    return good, results


def test_results_come_in_the_order_of_the_lines() -> None:
    class Slow(DeskClient):
        async def submit(self, *arguments: Any, **more: Any) -> Any:
            await anyio.sleep(0.02 if more["job_id"] == "job-0" else 0)
            return await super().submit(*arguments, **more)

    names = [f"job-{number}" for number in range(40)]
    client = Slow()
    good, results = handed_in(client, lines_of(*names))
    assert good
    assert [each.text() for each in results] == names
    assert results[0].data() == {"line": 1, "id": "job-0", "state": "open"}
    assert sorted(row.id for row in client.jobs) == sorted(names)


def test_one_that_the_team_refuses_does_not_keep_the_others_from_being_taken() -> None:
    client = DeskClient()
    handed_in(client, lines_of("taken", priority=1))
    good, results = handed_in(client, lines_of("a", "taken", "silent", "b"))
    assert not good
    assert [each.state for each in results] == ["open", "", "", "open"]
    assert results[1].text().startswith("line 2: taken: ")
    assert results[1].data()["cause"] == "conflict"
    assert results[2].data()["cause"] == "not_answered"


def test_without_robots_the_rest_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    client, tried = DeskClient(), []
    monkeypatch.setattr(DeskClient, "robots", property(lambda self: []))

    async def submit(*arguments: Any, **more: Any) -> Any:
        tried.append(more["job_id"])
        raise TimeoutError("nobody")

    monkeypatch.setattr(client, "submit", submit)
    good, results = handed_in(client, lines_of(*map(str, range(200))))
    assert not good
    assert len(results) == 200
    assert len(tried) <= job_lines.AT_ONCE
    assert "mrbt join" in results[-1].problem


def test_output_that_cannot_be_written_keeps_no_job_from_being_handed_in() -> None:
    client, names = DeskClient(), [f"job-{number}" for number in range(30)]

    def show(_: Result) -> None:
        raise BrokenPipeError

    with pytest.raises(BrokenPipeError):
        anyio.run(hand_in, client, lines_of(*names), show)
    assert sorted(row.id for row in client.jobs) == sorted(names)
