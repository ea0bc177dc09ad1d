"""Records and messages: round trips, limits, and that nothing malformed ever escapes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import msgpack
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import parse_record
from mrbt_mesh.core.facts.store import MAX_VALUE_BYTES, Entry, Incarnation, Version, parse_entry
from mrbt_mesh.core.facts.values import MAX_DATA_DEPTH, MAX_TEXT
from mrbt_mesh.core.membership import wire
from mrbt_mesh.core.membership.wire import (
    Header,
    Heartbeat,
    IncompatibleError,
    MessageKind,
    Position,
    RecordingHead,
    RequestAnswer,
    SelfReport,
    Suspicion,
    WireError,
    decode,
    encode,
    pack_entries,
    pack_heartbeat,
    parse_entries,
    parse_heartbeat,
    parse_pull,
)
from tests.support.plain_data import mutations, plain

SCOPE = "r1:0:a::0"
MINE = Header("0123456789abcdef", "repair", "r1", "A1")
SOMEONE = Header("0123456789abcdef", "repair", "r1", "B1")

incarnations = st.builds(Incarnation, st.integers(0, (1 << 53) - 1), st.text("abc0", max_size=32))
robots = st.from_regex(r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}", fullmatch=True)
digests = st.binary(min_size=8, max_size=8)
numbers = st.integers(0, (1 << 53) - 1)
words = st.builds(SelfReport, incarnations, numbers, digests, st.booleans(), st.integers(0, 3))
beats = st.builds(
    Heartbeat,
    words,
    st.booleans(),
    digests,
    st.tuples(*[st.integers(0, 3)] * 4),
    st.integers(0, 100),
    st.lists(
        st.builds(Suspicion, robots, incarnations, st.booleans(), st.booleans()), max_size=3
    ).map(tuple),
    st.dictionaries(robots, words, max_size=3),
    st.none() | st.tuples(st.text(max_size=8), st.text(max_size=8)),
    st.lists(st.builds(RequestAnswer, st.text(max_size=8), robots, numbers), max_size=3).map(tuple),
    digests,
    st.none()
    | st.builds(
        Position,
        st.integers(-(10**9), 10**9),
        st.integers(-(10**9), 10**9),
        st.none() | st.integers(-3_142, 3_142),
    ),
    st.lists(st.integers(0, 3), max_size=20).map(bytes),
    st.none()
    | st.builds(RecordingHead, st.integers(0, 2**40), st.binary(min_size=16, max_size=16)),
    st.integers(0, 2**40),
    st.none() | st.integers(0, 2**52),
)
GOOD_VALUES: list[tuple[str, Any]] = [
    (
        "member",
        [
            "A",
            {"drill": 5, "fix(2)": 7},
            {"worn": ["drill"]},
            False,
            "1.0",
            "host",
            77,
            True,
            {"no map": ["fix"]},
        ],
    ),
    ("claim", None),
    ("claim", "dock"),
    ("claim", [SCOPE, "a", "drill", 1, 3, ""]),
    ("claim", [SCOPE, "a", "drill", 4, 3, "", "dock"]),
    ("paused", ["pause", "anna", "op", "00ff"]),
    ("job/j1", [["bring", ["1"], -3, 0, 7, 9], "anna", "", ""]),
    ("job_hold/j1", ["now", "anna", "", ""]),
    ("mission/1", [["{}", True, False], "anna", "", ""]),
    (f"decision/{SCOPE}/A1.1.n.1", ["retry", "anna", "", ""]),
    (f"outcome/{SCOPE}/drill", [True, {"depth": [1.5, None]}]),
    ("condition/open(2)", [True, 1, 0]),
    (f"attempt/{SCOPE}", 3),
    (f"latched_failure/{SCOPE}", True),
    (f"expired/{SCOPE}", True),
    ("travel_times", [["dock", "gate"], [[0, 1_500], [None, 0]]]),
]
NAMES = [name for name, _ in GOOD_VALUES]


def entry(name: str, value: Any, author: str = "B1", sequence: int = 1) -> Entry:
    return parse_entry(author, name, Version(Incarnation(1, "n"), sequence), value)


def nested(depth: int) -> bytes:
    """Lists in lists, as bytes."""
    return b"\x91" * depth + b"\xc0"


def message(body: bytes, kind: str = "fact") -> bytes:
    """A message with a correct header around a packed body."""
    head = [wire.SCHEMA, kind, SOMEONE.mission, SOMEONE.mission_name, SOMEONE.run, SOMEONE.sender]
    return b"\x97" + b"".join(map(msgpack.packb, head)) + body


def test_a_clock_takes_no_byte_where_there_are_no_jobs() -> None:
    report = SelfReport(Incarnation(1, "n"), 1, bytes(8), True, 1)
    beat = Heartbeat(report, False, bytes(8), (0, 0, 0, 0), 0, (), {})
    packed = pack_heartbeat(beat)
    assert len(packed) == 19
    assert pack_heartbeat(replace(beat, unix_us=5)) == [*packed, 5]
    assert pack_heartbeat(replace(beat, steady_us=7)) == [*packed, None, 7]


# -- round trips ------------------------------------------------------------------------------


@given(beats)
def test_a_beat_survives_the_wire(beat: Heartbeat) -> None:
    data = encode(SOMEONE, MessageKind.HEARTBEAT, pack_heartbeat(beat))
    sender, body = decode(data, MINE, MessageKind.HEARTBEAT)
    assert (sender, parse_heartbeat(body)) == ("B1", beat)


@given(st.lists(st.tuples(st.sampled_from(GOOD_VALUES), robots, st.integers(1, 3)), max_size=8))
def test_entries_survive_the_wire_with_author_version_and_bytes(
    rows: list[tuple[tuple[str, Any], str, int]],
) -> None:
    sent = [entry(name, value, author, sequence) for (name, value), author, sequence in rows]
    data = encode(SOMEONE, MessageKind.STATE, pack_entries(sent))
    received, malformed = parse_entries(decode(data, MINE, MessageKind.STATE)[1])
    assert malformed == 0

    def by_key(entries: list[Entry]) -> list[tuple[Any, ...]]:
        return sorted((e.author, e.version, e.name, e.packed) for e in entries)

    assert by_key(received) == by_key(sent)
    assert {e.hash for e in received} == {e.hash for e in sent}


def test_a_batch_travels_whole_under_one_version() -> None:
    batch = [entry(name, value) for name, value in GOOD_VALUES[3:6]]
    (group,) = pack_entries(batch)
    assert group[:4] == ["B1", 1, "n", 1]
    assert [name for name, _ in group[4]] == NAMES[3:6]


@given(plain)
def test_an_outcome_may_carry_any_plain_data(value: Any) -> None:
    sent = entry(f"outcome/{SCOPE}/drill", [True, value])
    data = encode(SOMEONE, MessageKind.FACT, pack_entries([sent]))
    ((received,), _) = parse_entries(decode(data, MINE, MessageKind.FACT)[1])
    assert received.packed == sent.packed


@pytest.mark.parametrize(("name", "value"), GOOD_VALUES)
def test_what_is_written_is_what_was_parsed(name: str, value: Any) -> None:
    _, record = parse_record(name, value)
    if hasattr(record, "to_value"):
        assert record.to_value() == value


@given(
    st.dictionaries(robots, st.binary(min_size=16, max_size=16), max_size=5),
    st.dictionaries(robots, st.binary(min_size=512, max_size=512), max_size=2),
)
def test_a_question_survives_the_wire(summary: dict[str, bytes], parts: dict[str, bytes]) -> None:
    asked = summary, bytes(range(8)), parts
    data = encode(SOMEONE, MessageKind.PULL, [*asked])
    assert parse_pull(decode(data, MINE, MessageKind.PULL)[1]) == asked


# -- whatever arrives is decoded or refused ---------------------------------------------------


def read_everything(data: bytes, kind: MessageKind) -> None:
    """What an agent does with bytes from outside; anything but WireError is an error."""
    try:
        _, body = decode(data, MINE, kind)
        if kind is MessageKind.HEARTBEAT:
            parse_heartbeat(body)
        elif kind is MessageKind.PULL:
            parse_pull(body)
        else:
            parse_entries(body)
    except WireError as error:
        assert str(error)  # noqa: PT017 - refusing is as good as reading


kinds = st.sampled_from(MessageKind)


@given(st.binary(max_size=200), kinds)
@example(b"", MessageKind.HEARTBEAT)
@example(b"\xc1", MessageKind.FACT)
@example(b"\x81\x90\x01", MessageKind.FACT)
@example(b"\xd6\xff\x00\x00\x00\x00", MessageKind.FACT)
def test_arbitrary_bytes_are_refused_and_nothing_else_happens(
    data: bytes, kind: MessageKind
) -> None:
    with pytest.raises(WireError):
        decode(data, MINE, kind)


@given(plain, kinds)
def test_an_arbitrary_body_is_read_or_refused(body: Any, kind: MessageKind) -> None:
    read_everything(encode(SOMEONE, kind, body), kind)


@given(beats.flatmap(lambda beat: mutations(pack_heartbeat(beat))))
def test_a_beat_with_one_wrong_part_is_read_or_refused(body: Any) -> None:
    read_everything(encode(SOMEONE, MessageKind.HEARTBEAT, body), MessageKind.HEARTBEAT)


TABLE = pack_entries([entry(name, value) for name, value in GOOD_VALUES])


@given(mutations(TABLE))
def test_entries_with_one_wrong_part_are_read_or_refused(body: Any) -> None:
    read_everything(encode(SOMEONE, MessageKind.FACT, body), MessageKind.FACT)


@given(st.data())
def test_a_message_with_flipped_bytes_is_read_or_refused(data: st.DataObject) -> None:
    message_bytes = bytearray(encode(SOMEONE, MessageKind.FACT, TABLE))
    for position in data.draw(st.lists(st.integers(0, len(message_bytes) - 1), max_size=4)):
        message_bytes[position] = data.draw(st.integers(0, 255))
    read_everything(bytes(message_bytes), MessageKind.FACT)


@given(st.sampled_from([*NAMES, "claim/x", "nonsense", "", "outcome/a", "member/"]), plain)
def test_a_record_is_parsed_or_a_value_error(name: str, value: Any) -> None:
    try:
        _, record = parse_record(name, value)
    except ValueError as error:
        assert str(error)  # noqa: PT017 - refusing is as good as reading
    else:
        assert isinstance(record, records.Record)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("depth", [100, 500, 1000, 1020, 1023, 5000])
def test_deeply_nested_values_are_read_or_refused(name: str, depth: int) -> None:
    row = b"\x92" + msgpack.packb(name) + nested(depth)
    group = b"\x95" + b"".join(map(msgpack.packb, ["B1", 1, "n", 1])) + b"\x91" + row
    read_everything(message(b"\x91" + group), MessageKind.FACT)


def test_outcome_data_may_not_be_nested_too_deeply_to_be_shown_or_sent_on() -> None:
    value: Any = None
    for _ in range(MAX_DATA_DEPTH + 1):
        value = [value]
    with pytest.raises(ValueError, match="nested"):
        parse_record(f"outcome/{SCOPE}/drill", [True, value])
    assert parse_record(f"outcome/{SCOPE}/drill", [True, value[0]])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("travel_times", [["dock"], [[0, 1]]]),
        ("travel_times", [["dock", "dock"], [[0, 1], [1, 0]]]),
        ("travel_times", [["dock"], []]),
        ("travel_times", [["dock"], [[-1]]]),
        ("travel_times", [["dock"], [[1.5]]]),
        ("travel_times", [["dock"], [[10**9 + 1]]]),
        ("travel_times", [[f"p{n}" for n in range(101)], [[0] * 101] * 101]),
        ("member", ["A", {"drill": 0}, {}, False, "", "", 1, True, {}]),
        ("member", ["A", {"drill": True}, {}, False, "", "", 1, True, {}]),
        ("member", ["A", {1: 1}, {}, False, "", "", 1, True, {}]),
        ("member", ["A", {"drill": 1}, {"": ["x" * (MAX_TEXT + 1)]}, False, "", "", 1, True, {}]),
        ("member", ["A", {"drill": 1}, {"r" * 201: ["drill"]}, False, "", "", 1, True, {}]),
        ("member", ["A", {"drill": 1}, ["drill"], False, "", "", 1, True, {}]),
        ("member", ["A", {"drill": 1}, {"": "drill"}, False, "", "", 1, True, {}]),
        ("member", ["A", {"drill": 1}, {1: ["drill"]}, False, "", "", 1, True, {}]),
        ("member", ["A", {}, {}, False, "", "", 1, True, {"": ["a", 1]}]),
        ("member", ["A", {}, {"": ["a"] * 1001}, False, "", "", 1, True, {}]),
        ("member", ["A", {"drill": 1}, {}, 0, "", "", 1, True, {}]),
        ("member", ["A", {}, {}, False, "", "", -1, True, {}]),
        ("member", ["A", {}, {}, False, "", "", 1, 1, {}]),
        ("claim", [SCOPE, "a", "drill", 5, 1, ""]),
        ("claim", [SCOPE, "a", "drill", 1, 1, "", ""]),
        ("claim", [SCOPE, "a", "drill", 1, 1, "", 1]),
        ("claim", ""),
        ("claim", [SCOPE, "a", "drill", 1, 1]),
        ("claim", [SCOPE, "a", "drill", 1, -1, ""]),
        ("paused", ["start over", "anna", "", ""]),
        ("paused", ["abort", "anna", "", ""]),
        ("job_hold/j1", [True, "anna", "", ""]),
        ("job_hold/j1", ["held", ["two", "names"], "", ""]),
        (f"outcome/{SCOPE}/drill", [1, None]),
        (f"outcome/{SCOPE}/drill", [True]),
        ("condition/c", [True, 0, 0]),
        ("condition/c", [True, 1 << 53, 0]),
        (f"attempt/{SCOPE}", -1),
        (f"latched_failure/{SCOPE}", False),
        (f"expired/{SCOPE}", 1),
        ("outcome/" + "x" * records.MAX_NAME + "/a", [True, None]),
        ("condition", [True, 1, 0]),
        ("unheard-of", 1),
    ],
)
def test_what_is_not_exactly_its_kind_is_refused(name: str, value: Any) -> None:
    with pytest.raises(ValueError, match=r"."):
        parse_record(name, value)


def test_one_malformed_entry_does_not_cost_the_others() -> None:
    table = pack_entries([entry("aborted", [True, "", "", ""]), entry("claim", None)])
    table[0][4].insert(1, ["aborted", [False, "", "", ""]])
    good, malformed = parse_entries(table)
    assert ([e.name for e in good], malformed) == (["aborted", "claim"], 1)


# -- limits and incompatible teams ------------------------------------------------------------


def test_a_message_that_is_too_large_is_refused_before_it_is_read() -> None:
    data = encode(SOMEONE, MessageKind.FACT, b"x" * wire.MAX_MESSAGE_BYTES)
    with pytest.raises(WireError, match=f"at most {wire.MAX_MESSAGE_BYTES} are read"):
        decode(data, MINE, MessageKind.FACT)


def test_tables_longer_than_the_limit_are_refused() -> None:
    with pytest.raises(WireError, match="not msgpack"):
        decode(message(msgpack.packb([0] * (wire.MAX_ITEMS + 1))), MINE, MessageKind.FACT)


def test_extension_types_are_refused() -> None:
    body = msgpack.packb(msgpack.ExtType(5, b"abc"))
    with pytest.raises(WireError):
        decode(message(body), MINE, MessageKind.FACT)


@pytest.mark.parametrize(
    ("other", "texts"),
    [
        (
            Header("fedcba9876543210", "explore", "r1", "B1"),
            ["'explore'", "fedcba9876543210", "'repair'", "0123456789abcdef"],
        ),
        (Header("0123456789abcdef", "repair", "r2", "B1"), ["'r2'", "'r1'"]),
    ],
)
def test_another_mission_or_run_is_refused_with_both_sides_named(
    other: Header, texts: list[str]
) -> None:
    with pytest.raises(IncompatibleError) as caught:
        decode(encode(other, MessageKind.HEARTBEAT, None), MINE, MessageKind.HEARTBEAT)
    for text in texts:
        assert text in str(caught.value)


def test_another_schema_version_is_refused_with_both_versions_named() -> None:
    data = msgpack.packb([wire.SCHEMA + 1, "beat", "m", "n", "r", "B1", None])
    with pytest.raises(
        IncompatibleError, match=rf"schema {wire.SCHEMA + 1} \(ours is {wire.SCHEMA}\)"
    ):
        decode(data, MINE, MessageKind.HEARTBEAT)


@pytest.mark.parametrize("sender", ["../etc", "A 1", "a/b", "-x", "x" * 33])
def test_a_sender_that_is_no_robot_id_is_refused(sender: str) -> None:
    data = encode(Header(MINE.mission, "repair", "r1", sender), MessageKind.HEARTBEAT, None)
    with pytest.raises(WireError, match="sender is not a robot id"):
        decode(data, MINE, MessageKind.HEARTBEAT)


def test_a_message_of_another_kind_is_refused() -> None:
    with pytest.raises(WireError, match="kind 'fact' where beat is expected"):
        decode(encode(SOMEONE, MessageKind.FACT, None), MINE, MessageKind.HEARTBEAT)


@pytest.mark.parametrize("value", [object(), 1 << 64, {1, 2}, "\ud800", b"x" * MAX_VALUE_BYTES])
def test_outcome_data_that_cannot_be_sent_is_a_value_error(value: Any) -> None:
    with pytest.raises(ValueError, match=r"plain data|surrogates|bytes, at most"):
        entry(f"outcome/{SCOPE}/drill", [True, value])


@pytest.mark.parametrize(
    "where",
    [
        7,
        [],
        [1, 2],
        [1, 2, 3, 4],
        [1.5, 2, None],
        [10**9 + 1, 0, None],
        [0, 0, 7_000],
        [0, 0, False],
    ],
)
def test_a_position_that_is_none_is_refused(where: Any) -> None:
    report = SelfReport(Incarnation(1, "n"), 1, bytes(8), True, 0)
    body = pack_heartbeat(Heartbeat(report, False, bytes(8), (0, 0, 0, 0), 0, (), {}))
    *before, _, tree, head, signature, work_ms = body
    there = [1_500, -2_000, None]
    found = parse_heartbeat([*before, there, tree, head, signature, work_ms])
    assert found.position == Position(1_500, -2_000)
    with pytest.raises(WireError, match="position"):
        parse_heartbeat([*before, where, tree, head, signature, work_ms])


@pytest.mark.parametrize("statuses", ["", None, [1], b"\0\4", bytes(wire.MAX_TREE_NODES + 1)])
def test_statuses_of_a_tree_that_are_none_are_refused(statuses: Any) -> None:
    report = SelfReport(Incarnation(1, "n"), 1, bytes(8), True, 0)
    body = pack_heartbeat(Heartbeat(report, False, bytes(8), (0, 0, 0, 0), 0, (), {}))
    assert parse_heartbeat([*body[:-4], b"\1\2", *body[-3:]]).tree_statuses == b"\1\2"
    with pytest.raises(WireError, match="statuses of a tree"):
        parse_heartbeat([*body[:-4], statuses, *body[-3:]])


@pytest.mark.parametrize("head", [b"", [1], [1, bytes(15)], [-1, bytes(16)], [1, "0" * 16]])
def test_a_head_of_a_recording_that_is_none_is_refused(head: Any) -> None:
    report = SelfReport(Incarnation(1, "n"), 1, bytes(8), True, 0)
    body = pack_heartbeat(Heartbeat(report, False, bytes(8), (0, 0, 0, 0), 0, (), {}))
    with pytest.raises(WireError):
        parse_heartbeat([*body[:-3], head, *body[-2:]])
