"""A job's arguments are the same in Python, HTTP, the command line, its lines, and Open-RMF."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any
from unittest import mock

import anyio
from click.testing import CliRunner
from hypothesis import given, note
from hypothesis import strategies as st
from starlette.testclient import TestClient

from mrbt_mesh.adapters.rmf.own_errors import OwnErrors
from mrbt_mesh.adapters.rmf.requests import TaskApi
from mrbt_mesh.cli.commands import jobs
from mrbt_mesh.cli.main import main
from mrbt_mesh.core.mission.mission import MAX_NUMBER, Mission
from mrbt_mesh.runtime.team_client import JobRefusedError
from mrbt_mesh.views.web.api import Api
from tests.support.behaviour import mission_of
from tests.support.one_robot import DeskClient

MISSION = """
mission: m
ends: never
local_tasks: {{look: {{}}}}
robot_types: {{T: {{capabilities: {{look: 1}}}}}}
robots: {{D1: T}}
global_tasks: {{look: {{needs: {{look: {{}}}}}}}}
jobs: {{work: {{parameters: {parameters}, tree: look}}}}
tree: {{Jobs: all}}
"""
NAMES = ("shelf", "dock", "boxes", "x")
TEXTS = st.from_regex(r"[A-Za-z0-9_.+-]{1,6}", fullmatch=True)
NUMBERS = st.integers(-3, 12) | st.integers(-MAX_NUMBER, MAX_NUMBER)
CHOICES = st.lists(TEXTS | st.integers(-3, 12).map(str), min_size=1, max_size=3, unique=True)
RANGES = st.tuples(NUMBERS, NUMBERS).map(lambda ends: {"min": min(ends), "max": max(ends)})
PARAMETERS = st.dictionaries(st.sampled_from(NAMES), CHOICES | RANGES, max_size=3)


def number_given(number: int) -> st.SearchStrategy[Any]:
    """All that stands for a number."""
    return st.sampled_from([number, float(number), str(number)])


def value_of(kind: Any) -> st.SearchStrategy[Any]:
    """A value of a parameter, or mostly a wrong one, as a line of a command can say it, too."""
    if isinstance(kind, dict):
        good = st.integers(kind["min"], kind["max"]).flatmap(number_given)
    else:
        good = st.sampled_from(kind)
        numbers = [int(each) for each in kind if each.isdecimal() and str(int(each)) == each]
        good |= st.sampled_from(numbers or kind)
    return st.one_of(good, good, good, good, NUMBERS.flatmap(number_given), TEXTS, st.text())


def word(value: Any) -> str:
    return value if isinstance(value, str) else str(int(value))


def command(client: DeskClient, *words: str, lines: str = "") -> str:
    """What `mrbt submit` says of a mistake; empty: it has succeeded."""

    def act(_: Any, wanted: Callable[[DeskClient], Any], *__: Any) -> None:
        raise SystemExit(anyio.run(wanted, client))

    with mock.patch.object(jobs, "_with_client", act):
        result = CliRunner().invoke(main, ["submit", *words], input=lines.encode())
    assert result.exit_code in (0, 2), result.output
    return result.stderr


def ways(client: DeskClient, values: dict[str, Any]) -> dict[str, str]:
    """Hand in one job, of one id, in every way. Way -> what was said of a mistake; empty: none."""
    listed, said = list(values.values()), {}
    submitted: Any = {"order": (listed, {}), "names": ([], {"arguments": values})}
    for way, (order, more) in submitted.items():
        try:
            anyio.run(lambda o=order, m=more: client.submit("work", *o, job_id="a", **m))
            said[f"Python, {way}"] = ""
        except JobRefusedError as error:
            said[f"Python, {way}"] = str(error)
    page = TestClient(Api(client, None, lambda *_: "anna").application())  # type: ignore[arg-type]
    given = {"order": listed, "names": values}
    for way, arguments in given.items():
        body = {"type": "work", "id": "a", "arguments": arguments}
        answer = page.post("/jobs", json=body)
        assert answer.status_code in (201, 422)
        said[f"HTTP, {way}"] = answer.json().get("detail", "")
        said[f"lines, {way}"] = command(client, "--stdin", lines=json.dumps(body))
    words = {"order": map(word, listed), "names": (f"{n}={word(v)}" for n, v in values.items())}
    for way, each in words.items():
        said[f"words, {way}"] = command(client, "--id", "a", "work", "--", *each)
    api = TaskApi(client, "m", lambda: 0, OwnErrors("RMF"))
    request = {"category": "work", "description": values, "labels": ["id=a"]}
    text = json.dumps({"type": "dispatch_task_request", "request": request})
    dispatched, _ = anyio.run(api.answer, text)
    said["RMF"] = "" if dispatched["success"] else dispatched["errors"][0]["detail"]
    if not said["RMF"]:
        assert dispatched["state"]["detail"] == page.get("/jobs/a").json()["arguments"]
    return said


@given(PARAMETERS, st.data())
def test_all_ways_give_the_same_job_or_refuse_it(
    parameters: dict[str, Any], data: st.DataObject
) -> None:
    """The id is one, so that another job would be a conflict."""
    mission: Mission = mission_of(MISSION.format(parameters=json.dumps(parameters)))
    client = DeskClient(mission)
    values = {name: data.draw(value_of(kind)) for name, kind in parameters.items()}
    texts = [word(value) for value in values.values()]
    problem = mission.jobs["work"].problem(texts)
    said = ways(client, values)
    note(str(said))
    if problem:
        assert all(said.values())
        # A word with a `=` in it is a name to the command line.
        assert all(problem in text for text in said.values()) or any("=" in t for t in texts)
        assert client.jobs == []
        return
    assert not any(said.values())
    (row,) = client.jobs
    numbers = {name for name, kind in parameters.items() if isinstance(kind, dict)}
    pairs = zip(parameters, texts, strict=True)
    assert row.arguments == {name: int(t) if name in numbers else t for name, t in pairs}
    assert {name for name, value in row.arguments.items() if isinstance(value, int)} == numbers
    facts = client.watcher.observer.facts.jobs
    assert facts is not None
    assert facts.known["a"].job is not None
    assert list(facts.known["a"].job.arguments) == texts
