"""The description of the API is valid, and has every route."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator
from openapi_spec_validator import OpenAPIV31SpecValidator
from starlette.routing import Route

from mrbt_mesh.core.mission.job_arguments import ordered_arguments
from mrbt_mesh.core.mission.mission import JobParameter, JobType
from mrbt_mesh.runtime.team_client import TeamClient
from mrbt_mesh.views.model.team_view import TeamView
from mrbt_mesh.views.web.access import local_access
from mrbt_mesh.views.web.api import Api
from mrbt_mesh.views.web.feed import Feed
from mrbt_mesh.views.web.openapi import openapi
from tests.support.one_robot import MISSION
from tests.support.watched import WELD, watched


@pytest.mark.parametrize("has_tokens", [True, False])
def test_it_is_valid(has_tokens: bool) -> None:
    for mission in (None, MISSION):
        OpenAPIV31SpecValidator(openapi(has_tokens, mission=mission)).validate()


def test_it_has_every_route_with_its_methods() -> None:
    _, observer = watched(WELD)
    client = TeamClient(type("Watcher", (), {"observer": observer})())
    api = Api(client, Feed(TeamView(observer), lambda: 0), local_access(frozenset()))
    served = {
        (f"/v1{route.path}", method.lower())
        for route in api.application().routes
        if isinstance(route, Route)
        for method in route.methods or ()
        if method != "HEAD"
    }
    paths = openapi(has_tokens=True)["paths"].items()
    described = {(path, name) for path, item in paths for name in item if name != "parameters"}
    assert served == described


def test_a_stream_of_events_is_described_whole_and_event_by_event() -> None:
    answer = openapi(has_tokens=True)["paths"]["/v1/events"]["get"]["responses"]["200"]
    judge = Draft202012Validator(answer["content"]["text/event-stream"]["schema"])
    assert judge.is_valid('id: a.1\nevent: begin\ndata: {"now_s":1.0}\n\n')
    assert judge.is_valid({"id": "a.1", "event": "begin", "data": '{"now_s":1.0}'})
    assert not judge.is_valid({"id": "a.1", "event": "begin"})
    assert not judge.is_valid({"data": {"now_s": 1.0}})


NUMBERS = st.integers(-20, 120)
RANGES = st.tuples(NUMBERS, NUMBERS).map(lambda ends: ("", *sorted(ends)))
CHOICES = st.lists(st.sampled_from(["a", "3", "-1", "07", "1.5"]), min_size=1, unique=True)
PARAMETERS = st.lists(RANGES | CHOICES.map(tuple), max_size=3)
VALUES = st.sampled_from(["a", "3", "-1", "07", "1.5", "3 ", "", True, None, 1.5, [], 1e300])
VALUES |= NUMBERS | NUMBERS.map(str) | NUMBERS.map(float)


@given(PARAMETERS, st.data())
def test_it_has_the_arguments_that_a_type_takes_and_no_others(
    kinds: list[tuple[Any, ...]], data: st.DataObject
) -> None:
    """As generators of requests read it."""
    parameters = tuple(
        JobParameter(f"p{n}", (), *kind[1:]) if kind[0] == "" else JobParameter(f"p{n}", kind)
        for n, kind in enumerate(kinds)
    )
    kind = JobType("work", parameters)
    document = openapi(False, mission=replace(MISSION, jobs=MISSION.jobs | {"work": kind}))
    schema = document["components"]["schemas"]["Submission"]
    good = [st.sampled_from([*each.values()]) for each in parameters]
    drawn = [data.draw(VALUES | each | each | each) for each in good]
    drawn += data.draw(st.sampled_from([[]] * 5 + [["a"]]))
    names = data.draw(st.sampled_from([[f"p{n}" for n in range(len(drawn))]] * 5 + [["p0", "q"]]))
    for given_ in (drawn, dict(zip(names, drawn, strict=False))):
        try:
            is_taken = not kind.problem(ordered_arguments(kind, given_))
        except ValueError:
            is_taken = False
        body = {"type": "work", "arguments": given_}
        assert Draft202012Validator(schema).is_valid(body) is is_taken, body
