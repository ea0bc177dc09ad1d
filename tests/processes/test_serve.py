"""The HTTP API of a team of real processes, by one server and by two of which one is killed."""

from __future__ import annotations

import itertools
import json
import re
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import httpx2 as httpx
import pytest
from jsonschema import Draft202012Validator

from tests.support.paths import mission_file
from tests.support.team import WAIT_S, Team

DELIVERIES = mission_file("deliveries")
ANNA, BOARD = "a-secret-of-anna-0001", "a-secret-of-board-0002"
TOKENS = (
    f"tokens: {{anna: {{role: operator, token: {ANNA}}}, board: {{role: viewer, token: {BOARD}}}}}"
)


def up(team: Team) -> None:
    team.up(DELIVERIES, speed=20)
    team.wait_until(lambda: len(team.robots()) == 6, "all are there")


class Described:
    """A client that holds every answer against the server's own description."""

    def __init__(self, address: str, token: str = "") -> None:
        headers = {"authorization": f"Bearer {token}"} if token else {}
        self.http = httpx.Client(base_url=address, headers=headers, timeout=WAIT_S)
        self.document = self.http.get("openapi.json").json()

    def close(self) -> None:
        self.http.close()

    def ask(self, method: str, path: str, body: Any = None) -> tuple[int, Any]:
        answer = self.http.request(method, path, json=body)
        names = (re.sub(r"\{\w+\}", "[^/]+", name) for name in self.document["paths"])
        operations = dict(zip(names, self.document["paths"].values(), strict=True))
        plain = f"/{path.partition('?')[0]}"
        item = next(item for name, item in operations.items() if re.fullmatch(name, plain))
        content = item[method.lower()]["responses"][str(answer.status_code)]["content"]
        kind = answer.headers["content-type"]
        schema = content[kind]["schema"] | {"components": self.document["components"]}
        Draft202012Validator(schema).validate(answer.json())
        return answer.status_code, answer.json()


def test_the_api_and_its_errors(team: Team, tmp_path: Path) -> None:
    up(team)
    file = tmp_path / "tokens.yaml"
    file.write_text(TOKENS)
    _, address = team.serve("--tokens", str(file))
    with ExitStack() as stack:
        clients = (Described(address, token) for token in (ANNA, BOARD, ""))
        walk(team, *(stack.enter_context(closing(client)) for client in clients))


def walk(team: Team, anna: Described, board: Described, nobody: Described) -> None:
    """Ask for everything, and make every mistake."""
    assert nobody.ask("GET", "v1/status")[0] == 401
    status = board.ask("GET", "v1/status")[1]
    assert status["mission"] == "deliveries"
    assert set(status["robots"]) == {"C1", "C2", "C3", "C4", "D1", "D2"}
    deliver = board.ask("GET", "v1/job-types")[1][0]
    assert (deliver["name"], deliver["priority"], deliver["deadline_s"]) == ("deliver", 5, 600)
    assert deliver["parameters"][2] == {"name": "boxes", "choices": [], "min": 1, "max": 4}
    job = {"type": "deliver", "arguments": {"shelf": "shelf_1", "dock": "dock_1", "boxes": 2}}
    held = {"id": "one", "type": "inspect", "arguments": {"where": "shelf_2"}, "not_before": "PT1H"}
    assert board.ask("POST", "v1/jobs", job)[0] == 403
    assert anna.ask("POST", "v1/jobs", held) == (201, {"id": "one", "state": "open"})
    assert anna.ask("POST", "v1/jobs", held) == (201, {"id": "one", "state": "open"})
    other = held | {"arguments": {"where": "shelf_3"}}
    code, problem = anna.ask("POST", "v1/jobs", other)
    assert (code, problem["status"]) == (409, 409)
    assert "another job of this id, one: inspect(shelf_2)" in problem["detail"]
    for wrong, text in (
        (job | {"type": "paint"}, "no job type 'paint'; known: deliver, inspect"),
        (job | {"arguments": {}}, "deliver takes the arguments shelf, dock, boxes; given: none"),
        (job | {"arguments": job["arguments"] | {"boxes": 9}}, "a whole number from 1 to 4"),  # type: ignore[operator]
        (
            job | {"priority": "high"},
            "priority: a whole number is expected",
        ),
        (job | {"safe": 9}, "the mission has 6 robots"),
        (job | {"deadline": "2020-05-04T14:30:00Z"}, "its deadline has passed, by the team's"),
        (job | {"deadline": "2020-05-04T14:30:00"}, "deadline"),
        (job | {"colour": "red"}, "colour: there is no such field"),
        ([], "the body: an object is expected, a list was sent"),
    ):
        code, problem = anna.ask("POST", "v1/jobs", wrong)
        assert code == (409 if "has passed" in text else 422), problem
        assert text in problem["detail"]
    code, row = board.ask("GET", "v1/jobs/one")
    assert (row["operator"], row["why"][:11], row["state"]) == ("anna", "not before ", "waiting")
    assert anna.ask("POST", "v1/jobs/one/hold", {}) == (200, {"id": "one", "state": "held"})
    assert anna.ask("POST", "v1/jobs/one/priority", {"priority": 3})[0] == 200
    assert anna.ask("POST", "v1/jobs/one/priority", {})[0] == 422
    team.wait_until(lambda: board.ask("GET", "v1/jobs?state=held")[1], "the job is held")
    assert anna.ask("POST", "v1/jobs/one/release")[1]["state"] == "open"
    assert anna.ask("POST", "v1/jobs/one/cancel")[1]["state"] == "cancelled"
    assert board.ask("POST", "v1/jobs/one/cancel")[0] == 403
    assert anna.ask("POST", "v1/jobs/two/cancel")[0] == 404
    assert anna.ask("GET", "v1/jobs/two")[0] == 404
    name = follow_events(anna, job)
    row = board.ask("GET", f"v1/jobs/{name}")[1]
    assert row["submitted_us"] <= row["begun_us"] <= row["ended_us"]
    assert (row["attempts"], bool(row["robots"])) == (1, True)
    assert len(board.ask("GET", "v1/jobs?limit=1")[1]) == 1
    assert board.ask("GET", "v1/jobs?limit=x")[0] == 422
    team.kill_all()

    def are_dead() -> bool:
        robots = anna.ask("GET", "v1/status")[1]["robots"].values()
        return all(robot["state"] == "dead" for robot in robots)

    team.wait_until(are_dead, "the server knows that all are dead")
    assert anna.ask("POST", "v1/jobs", job)[0] == 503


def follow_events(client: Described, job: dict[str, Any]) -> str:
    """A job is seen from its submission to its end, by a reader that is cut off in between, and by
    one that reads whole answers. The job's id.
    """
    schema = client.document["components"]["schemas"]["News"]
    validator = Draft202012Validator(schema | {"components": client.document["components"]})
    name, last, states, kinds = "", "", [], []
    while "succeeded" not in states:
        with client.http.stream("GET", "v1/events", headers={"last-event-id": last}) as stream:
            lines = stream.iter_lines()
            for _ in range(2):
                last, kind, data = (next(lines).partition(": ")[2] for _ in range(3))
                assert next(lines) == ""
                kinds.append(kind)
                validator.validate(json.loads(data))
                items = json.loads(data)["items"]
                if name and (row := items.get(f"job/{name}")):
                    states.append(row["state"])
            name = name or client.ask("POST", "v1/jobs", job)[1]["id"]
    assert set(states) <= {"waiting", "running", "succeeded"}
    assert (kinds[0], set(kinds[1:])) == ("begin", {"news"})
    whole = client.http.get("v1/events?limit=1", headers={"last-event-id": last}).text
    assert whole.startswith("id: ")
    assert whole.count("\n\n") == 1
    return name


@pytest.mark.smoke
def test_a_client_of_two_servers_notices_nothing_when_one_is_killed(team: Team) -> None:
    up(team)
    (first, one), (_, two) = team.serve(), team.serve()
    count = 40
    others_failed: list[str] = []

    def submit(number: int) -> Any:
        """At one of the servers; the same job again at the other one if that fails."""
        body = {"id": f"job-{number}", "type": "inspect", "arguments": {"where": "shelf_1"}}
        for address in itertools.cycle((one, two) if number % 2 else (two, one)):
            if number == count // 2:
                first.kill()
            try:
                answer = httpx.post(f"{address}v1/jobs", json=body, timeout=WAIT_S)
            except httpx.TransportError as error:
                others_failed.append(str(error))
                continue
            return answer.raise_for_status().json()["id"]
        return None

    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(submit, range(count))) == [f"job-{n}" for n in range(count)]
    assert others_failed, "no request was lost"

    def jobs() -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = httpx.get(f"{two}v1/jobs", timeout=WAIT_S).json()
        return found

    team.wait_until(lambda: all(row["state"] == "succeeded" for row in jobs()), "all are done")
    assert sorted(row["id"] for row in jobs()) == sorted(f"job-{n}" for n in range(count))
    done = team.wait_for_events(count, "look", "end")
    counts = Counter(re.search(r"job-\d+", event["activation"])[0] for event in done)  # type: ignore[index]
    assert counts == {f"job-{n}": 1 for n in range(count)}


def test_an_address_that_others_reach_takes_tokens(team: Team) -> None:
    refused = team.command("serve", "--host", "0.0.0.0")
    assert refused.returncode == 2
    assert "others reach this address, so give their tokens with --tokens FILE" in refused.stderr
