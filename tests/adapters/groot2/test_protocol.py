"""Groot2's protocol, byte by byte."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.adapters.groot2.protocol import (
    MonitorRequest,
    error_reply,
    parse_request,
    shown,
    status_buffer,
    transition,
)

TREE_ID = bytes(range(16))


def test_a_request_and_the_header_of_its_answer() -> None:
    """As BehaviorTree.CPP's publisher answers: the request again, and the tree's id."""
    request = parse_request(b"\x02SM\x00\x00\x00")
    assert request == MonitorRequest(ord("S"), 77)
    assert request.reply_header(TREE_ID) == b"\x02SM\x00\x00\x00" + TREE_ID


@pytest.mark.parametrize(
    "header",
    [b"", b"\x02S", b"\x02SM\x00\x00\x00\x00", b"\x01SM\x00\x00\x00", b"\x03SM\x00\x00\x00"],
)
def test_what_is_no_request_of_this_protocol(header: bytes) -> None:
    assert parse_request(header) is None


@given(st.binary(max_size=40))
def test_any_bytes_are_a_request_or_none(header: bytes) -> None:
    request = parse_request(header)
    if request is not None:
        assert request.reply_header(b"")[:6] == header


def test_statuses_take_three_bytes_each() -> None:
    assert status_buffer([1, 2, 12]) == b"\x01\x00\x01\x02\x00\x02\x03\x00\x0c"
    assert status_buffer([0] * 300)[-3:] == b"\x2c\x01\x00"


@pytest.mark.parametrize(
    ("story", "expected"),
    [
        ([0], 0),
        ([1], 1),
        ([1, 0], 11),
        ([1, 2, 0], 12),
        ([1, 3, 0], 13),
        ([1, 3, 0, 0], 13),
        ([1, 3, 0, 1], 1),
    ],
)
def test_a_node_that_is_idle_again_shows_what_it_was(story: list[int], expected: int) -> None:
    status = 0
    for each in story:
        status = shown(status, each)
    assert status == expected


def test_a_transition_takes_nine_bytes() -> None:
    assert transition(0x010203040506, 0x0708, 3) == b"\x06\x05\x04\x03\x02\x01\x08\x07\x03"
    assert transition((1 << 48) + 5, 1, 0) == transition(5, 1, 0)


def test_an_error_has_two_parts() -> None:
    assert error_reply("why") == [b"error", b"why"]
