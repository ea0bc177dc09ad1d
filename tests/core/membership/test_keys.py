"""Facts keep their author's word, whoever passes them on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.agent.operator_messages import command_version
from mrbt_mesh.core.facts.records import OPERATORS, ConditionValue, RobotProblem
from mrbt_mesh.core.facts.store import Entry, Fact, parse_entry
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.keys import NOT_AUTHENTIC, Role, command_content
from mrbt_mesh.core.membership.replica import Replica
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import Header, MessageKind, decode, encode
from mrbt_mesh.core.mission.compiled import compile_mission
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.features.revisions.revise import revise
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.runtime.member_keys import MemberKeys
from tests.support import build
from tests.support.keys import keys_of

MISSION: Mission = build.make_mission(
    build.sequence(build.condition("open"), build.action("t")),
    {"A": {"t": 1.0}, "B": {"t": 1.0}, "C": {"t": 1.0}},
    [build.task("t", ("t", 1, 1))],
)
KEYS = keys_of("A", "B", "C", observer="eye")


def replica(
    name: str,
    keys: MemberKeys | None = None,
    run: str = build.RUN,
    mission: Mission = MISSION,
) -> Replica:
    header = Header(mission.digest[:16], mission.name, run, name)
    found = Replica(
        TeamFacts(mission, run), header, Timing(), name.lower(), keys=keys or KEYS.get(name)
    )
    found.next_incarnation(0)
    return found


def said(stamp: int = 1) -> list[Fact]:
    """A batch of two facts."""
    return [
        ("problem/clock", RobotProblem(str(stamp))),
        ("condition/open", ConditionValue(True, stamp, stamp)),
    ]


def answer(source: Replica, asker: Replica, change: Any = None) -> bytes:
    """What `source` answers to `asker`, its groups of entries changed on the way."""
    (page,) = source.answer_pull(asker.write_pull())
    if change is None:
        return page
    _, body = decode(page, source.header, MessageKind.STATE)
    change(body[1])
    return encode(source.header, MessageKind.STATE, body)


def facts(of: Replica) -> dict[str, Any]:
    return {f"{entry.author} {entry.name}": entry.value for entry in of.facts.map}


def test_facts_are_passed_on_and_believed() -> None:
    a, b, c = replica("A"), replica("B"), replica("C")
    data, _ = a.write(said(), 0)
    assert len(b.receive("A", data, 0).changed) == 2
    found = c.receive_state("B", answer(b, c), 0)
    assert (len(found.changed), found.refused) == (2, 0)
    assert c.facts.map.digest() == b.facts.map.digest() == a.facts.map.digest()


def test_what_stands_of_an_old_batch_is_believed_when_the_rest_is_gone() -> None:
    a, b, c = replica("A"), replica("B"), replica("C")
    for values in (said(1), [("problem/clock", RobotProblem("2"))]):
        b.receive("A", a.write(values, 0)[0], 0)
    c.receive_state("B", answer(b, c), 0)
    assert facts(c) == facts(a)
    d = replica("B")
    d.receive_state("C", answer(c, d), 0)
    assert facts(d) == facts(a)


def raise_sequence(groups: list[Any]) -> None:
    groups[0][3] += 1


def raise_incarnation(groups: list[Any]) -> None:
    groups[0][1] += 1


def change_value(groups: list[Any]) -> None:
    groups[0][4][0][1] = "9"


def change_author(groups: list[Any]) -> None:
    groups[0][0] = "C"


def take_proof_away(groups: list[Any]) -> None:
    groups[0][5] = None


def add_an_entry(groups: list[Any]) -> None:
    groups[0][4][:] = [["problem/clock", "9"]]


def change_hashes(groups: list[Any]) -> None:
    groups[0][5][0] = bytes(len(groups[0][5][0]))


def empty_proof(groups: list[Any]) -> None:
    groups[0][5] = [b"", b""]


@pytest.mark.parametrize(
    "change",
    [
        *(raise_sequence, raise_incarnation, change_value, change_author),
        *(take_proof_away, add_an_entry, change_hashes, empty_proof),
    ],
)
def test_whoever_passes_facts_on_cannot_change_them(change: Any) -> None:
    a, b, c = replica("A"), replica("B"), replica("C")
    b.receive("A", a.write([("problem/clock", RobotProblem("1"))], 0)[0], 0)
    found = c.receive_state("B", answer(b, c, change), 0)
    assert (found.changed, found.refused, found.reason) == ([], 1, NOT_AUTHENTIC)
    assert facts(c) == {}


def test_an_entry_in_anothers_name_signed_with_a_key_of_ones_own_is_refused() -> None:
    """A robot with a valid key writes an order of C."""
    forger = replica("C", keys=KEYS["A"])
    data, _ = forger.write([("problem/clock", RobotProblem("9"))], 0)
    found = replica("B").receive("C", data, 0)
    assert (found.changed, found.reason) == ([], NOT_AUTHENTIC)


@pytest.mark.parametrize("name", ["op", "eye"])
def test_who_is_no_robot_writes_nothing(name: str) -> None:
    data, _ = replica(name).write([("problem/clock", RobotProblem("9"))], 0)
    assert replica("B").receive(name, data, 0).reason == NOT_AUTHENTIC


def test_batches_of_another_run_are_refused() -> None:
    """Their entries, put into messages of this run."""
    other, c = replica("A", run="other"), replica("C")
    _, entries = other.write([("problem/clock", RobotProblem("9"))], 0)
    proof = entries[0].proof
    assert proof is not None
    version = entries[0].version
    rows = [["problem/clock", "9"]]
    shown = [proof.hashes, proof.signature]
    group = ["A", *version.incarnation, version.sequence, rows, shown]
    data = encode(
        Header(MISSION.digest[:16], MISSION.name, build.RUN, "A"), MessageKind.FACT, [group]
    )
    assert c.receive("A", data, 0).reason == NOT_AUTHENTIC


def test_the_proof_is_no_part_of_what_a_fact_says() -> None:
    signed, plain = (
        replica("A"),
        Replica(
            TeamFacts(MISSION, build.RUN),
            Header(MISSION.digest[:16], MISSION.name, build.RUN, "A"),
            Timing(),
            "a",
        ),
    )
    plain.next_incarnation(0)
    one, other = signed.write(said(), 0)[1], plain.write(said(), 0)[1]
    assert one == other
    assert [entry.proof is None for entry in (*one, *other)] == [False, False, True, True]
    assert signed.facts.map.digest() == plain.facts.map.digest()


def test_a_journal_is_believed_and_passed_on() -> None:
    a = replica("A")
    _, entries = a.write(said(), 0)
    again, c = replica("A"), replica("C")
    again.restore(entries)
    assert len(c.receive_state("B", answer(again, c), 0).changed) == 2


def test_a_batch_is_checked_once_however_many_entries_it_has() -> None:
    a = replica("A")
    data, entries = a.write(said(), 0)
    keys = Counting(KEYS["B"])
    b = replica("B", keys=keys)
    b.receive("A", data, 0)
    b.receive("A", data, 0)
    assert keys.checks == 1
    assert len({id(entry.proof) for entry in entries}) == 1


class Counting(MemberKeys):
    """Counts how often a batch's signature is looked at."""

    def __init__(self, keys: MemberKeys) -> None:
        self.__dict__.update(keys.__dict__)
        self.checks = 0

    def was_signed(self, name: str, data: bytes, signature: bytes, role: Role = Role.ROBOT) -> bool:
        self.checks += 1
        return super().was_signed(name, data, signature, role)


WITH_JOBS = mission_from_yaml(
    """
mission: m
ends: never
local_tasks: {take: {parameters: [what]}}
robot_types: {cart: {capabilities: {take: 1}}}
robots: {A: cart, B: cart}
global_tasks: {fetch: {parameters: [what], needs: {take($what): {min: 1}}}}
jobs: {bring: {parameters: {what: {min: 1, max: 9}}, tree: fetch($what)}}
tree: {Jobs: all}
""",
    "m.yaml",
    Path(),
)
BRING = "job/1", ["bring", ["1"], 5, 0, 0, 7]
REVISED = "mission/1", [compile_mission(revise(WITH_JOBS, WITH_JOBS)), False, False]
COMMANDS = [
    BRING,
    REVISED,
    ("mission_withdrawn/1", True),
    ("paused", "pause"),
    ("aborted", True),
    ("borrowed/A", "at_once"),
    ("job_cancelled/1", True),
    ("job_hold/1", "held"),
    ("job_priority/1", 9),
]
SIGNED = {"name": "", "run": build.RUN, "stamp": 3, "id": "c", "operator": "anna"}


def as_signed(name: str, value: Any, signer: str, other: dict[str, Any]) -> Entry:
    """A command that `signer` has signed, perhaps as something else."""
    what = {**SIGNED, "name": name} | other
    version = command_version(what["stamp"], what["id"])
    values = [value, what["operator"]]
    signature = ""
    if signer:
        content = command_content(what["run"], what["name"], version, values)
        signature = KEYS[signer].sign(content).hex()
    return parse_entry(OPERATORS, name, command_version(3, "c"), [value, "anna", signer, signature])


@pytest.mark.parametrize(("name", "value"), COMMANDS, ids=[name for name, _ in COMMANDS])
@pytest.mark.parametrize(
    ("signer", "other", "is_believed"),
    [
        ("op", {}, True),
        ("A", {}, False),  # a robot
        ("eye", {}, False),  # an observer
        ("", {}, False),
        ("op", {"name": "other/1"}, False),
        ("op", {"run": "other"}, False),
        ("op", {"operator": "bert"}, False),
        ("op", {"stamp": 2}, False),
        ("op", {"id": "d"}, False),
    ],
    ids=["good", "robot", "observer", "nobody", "name", "run", "operator", "stamp", "id"],
)
def test_what_operators_command_no_robot_can_make(
    name: str, value: Any, signer: str, other: dict[str, Any], is_believed: bool
) -> None:
    a, b = replica("A", mission=WITH_JOBS), replica("B", mission=WITH_JOBS)
    data = a.take_command(as_signed(name, value, signer, other), 0)
    found = b.receive("A", data, 0)
    assert (len(found.changed), found.refused) == ((1, 0) if is_believed else (0, 1))
    assert found.reason == ("" if is_believed else NOT_AUTHENTIC)


@pytest.mark.parametrize(("name", "value"), COMMANDS, ids=[name for name, _ in COMMANDS])
def test_a_robot_cannot_write_a_command_as_its_own_fact(name: str, value: Any) -> None:
    """It may sign it as a robot, as well, and repeat what an operator has signed."""
    a, b = replica("A", mission=WITH_JOBS), replica("B", mission=WITH_JOBS)
    data, _ = a.write([(name, as_signed(name, value, "op", {}).record)], 0)
    found = b.receive("A", data, 0)
    assert (found.changed, found.refused) == ([], 1)
    assert "is not for operators" not in found.reason


@given(st.data())
def test_no_changed_byte_of_a_page_changes_a_fact(data: st.DataObject) -> None:
    a, b, c = replica("A"), replica("B"), replica("C")
    b.receive("A", a.write(said(), 0)[0], 0)
    page = bytearray(answer(b, c))
    for _ in range(data.draw(st.integers(1, 4))):
        page[data.draw(st.integers(0, len(page) - 1))] ^= data.draw(st.integers(1, 255))
    try:
        changed: list[Entry] = c.receive_state("B", bytes(page), 0).changed
    except ValueError:
        return
    for entry in changed:
        mine = a.facts.map.get(entry.author, entry.name)
        assert mine == entry
    assert msgpack.unpackb(msgpack.packb(facts(c))).items() <= facts(a).items()
