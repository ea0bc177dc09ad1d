"""Commands about jobs: what is refused, in words for the operator, and what is answered."""

from __future__ import annotations

import json
from typing import Any

import pytest

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.effects import Reply
from mrbt_mesh.core.agent.job_desk import CHANGE_JOB, KEPT_JOB, SUBMIT, JobDesk
from mrbt_mesh.core.agent.jobs_on_disk import MAX_WAITING, AwaitedJob
from mrbt_mesh.core.membership.keys import submission_content
from tests.support.keys import keys_of
from tests.support.one_robot import desk

S = 1_000_000
JOB = {"id": "a", "type": "inspect", "arguments": ["shelf_1"], "operator": "me"}


def asked(found: JobDesk, command: str, **given: Any) -> Any:
    answer = found.answer(command, json.dumps(given), 0)
    return answer if isinstance(answer, AwaitedJob) else json.loads(answer)


def answered(context: Context) -> list[int]:
    context.answer_kept()
    return [effect.query for effect in context.take_effects() if isinstance(effect, Reply)]


def test_a_query_for_a_job_is_answered_once_the_disk_has_it() -> None:
    found, context = desk()
    # The last one is a change that another robot has taken, of which this one has not heard yet.
    for query, (name, stamp) in enumerate((("a", 1), ("b", 1), ("a", 2))):
        context.jobs_on_disk.wait(query, asked(found, KEPT_JOB, id=name, stamp=stamp))
    asked(found, SUBMIT, **JOB)
    assert answered(context) == []
    context.durability.note_synced(context.durability.take_number())
    assert answered(context) == [0]
    asked(found, CHANGE_JOB, id="a", change="hold")
    assert answered(context) == []
    context.durability.note_synced(context.durability.take_number())
    assert answered(context) == [2]
    assert "stamp is missing" in asked(found, KEPT_JOB, id="a")["refused"]


def test_the_oldest_of_too_many_queries_are_forgotten() -> None:
    found, context = desk()
    for query in range(MAX_WAITING + 1):
        context.jobs_on_disk.wait(query, AwaitedJob("a", 1))
    asked(found, SUBMIT, **JOB)
    context.durability.note_synced(context.durability.take_number())
    assert answered(context) == list(range(1, MAX_WAITING + 1))


def test_the_same_id_is_the_same_job() -> None:
    found, context = desk()
    assert asked(found, SUBMIT, **JOB)["state"] == "open"
    (job,) = (entry for entry in context.facts.map if entry.parts[0] == "job")
    assert job.record.to_value() == ["inspect", ["shelf_1"], 0, 0, 0, "me", 1, "", ""]
    assert asked(found, CHANGE_JOB, id="a", change="priority", priority=7)["priority"] == 7
    assert asked(found, CHANGE_JOB, id="a", change="hold")["state"] == "held"
    assert asked(found, CHANGE_JOB, id="a", change="cancel")["state"] == "cancelled"
    assert asked(found, CHANGE_JOB, id="a", change="release")["state"] == "cancelled"
    assert asked(found, SUBMIT, **JOB)["state"] == "cancelled"


def test_a_robot_that_has_not_read_its_clock_takes_none_yet() -> None:
    answer = asked(desk(clock_us=None)[0], SUBMIT, **JOB)
    assert answer == {"refused": "D1 has not read its clock yet", "cause": "not_ready"}


@pytest.mark.parametrize(
    ("signer", "priority", "is_taken"), [("op", 3, True), ("op", 4, False), ("D1", 3, False)]
)
def test_in_a_team_with_keys_an_operator_signs_the_whole_job(
    signer: str, priority: int, is_taken: bool
) -> None:
    keys = keys_of("D1")
    found, _ = desk(keys["D1"])
    values = ["inspect", ["shelf_1"], 3, 0, 0, "me"]
    signature = keys[signer].sign(submission_content("r", "job/a", values)).hex()
    answer = asked(
        found, SUBMIT, **JOB, priority=priority, deadline_us=0, signer=signer, signature=signature
    )
    if is_taken:
        assert answer["state"] == "open"
    else:
        assert answer["refused"] == "no operator of this team has signed it"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"type": "paint"}, "no job type 'paint'; there is deliver, inspect"),
        ({"arguments": []}, "inspect takes 1 argument (where)"),
        ({"arguments": [1]}, "arguments is missing, or is no list of texts"),
        ({"arguments": ["moon"]}, "where is one of dock_1,"),
        ({"id": "a b"}, "'a b' is no id: 1 to 64 letters"),
        ({"priority": "high"}, "a priority is a whole number"),
        ({"deadline_us": -1}, "deadline_us is a Unix time in whole microseconds"),
        ({"not_before_us": 400 * 86_400 * S}, "not_before_us is a Unix time in whole"),
        ({"deadline_us": 999 * S}, "its deadline has passed, by the team's clocks"),
        ({"deadline_us": 1_001 * S, "not_before_us": 1_002 * S}, "is before the time at which"),
        ({"operator": None}, "operator is missing, or is not one line of printable text"),
        ({"operator": "\ud800"}, "operator is missing, or is not one line"),
        ({"operator": "a" * 641}, "printable text of at most 640 characters"),
        ({"signature": "0" * 641}, "signature is missing, or is not one line of printable text"),
        ({"id": "taken"}, "another job of this id, taken: inspect(shelf_2); choose another id"),
    ],
)
def test_a_wrong_job_is_refused_with_the_remedy_and_writes_nothing(
    change: dict[str, Any], message: str
) -> None:
    found, context = desk()
    asked(found, SUBMIT, **{**JOB, "id": "taken", "arguments": ["shelf_2"]})
    before = len(context.facts.map)
    assert message in asked(found, SUBMIT, **{**JOB, **change})["refused"]
    assert len(context.facts.map) == before


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "a JSON object is expected"),
        ("[" * 4_000, "a JSON object is expected"),
        ("[]", "a JSON object is expected"),
        ('{"id": "a"}', "change is missing"),
        ('{"id": "a", "change": "paint"}', "no job 'a' is known here"),
    ],
)
def test_a_wrong_change_is_refused(text: str, message: str) -> None:
    found, _ = desk()
    assert message in json.loads(found.answer(CHANGE_JOB, text, 0))["refused"]
