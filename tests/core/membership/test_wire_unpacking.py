"""Whatever a message says, to take it apart costs a few times its own size."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.membership.envelope import ForgedError, parse_envelope
from mrbt_mesh.core.membership.wire import (
    LONG_BYTES,
    MAX_MESSAGE_BYTES,
    SEALED,
    SHORT_BYTES,
    unpacked,
)

MUCH = 50 << 20
LIST_OF_99_000 = b"\xdd" + (99_000).to_bytes(4, "big")
ENVELOPE = b"\x98" + msgpack.packb(SEALED)
GOOD_ENVELOPE = msgpack.packb([SEALED, "run", "A", 1, 1, "", b"", {}])


def by_eights(size: int) -> bytes:
    """Lists of eight in lists of eight: no list is long."""
    found = b"\x90"
    while 8 * len(found) + 1 < size:
        found = b"\x98" + 8 * found
    return found


def read(data: bytes) -> object:
    return unpacked(data, 1_000)


@pytest.mark.parametrize(
    ("take", "data"),
    [
        (read, b"\x9e" + 14 * (LIST_OF_99_000 + 99_000 * b"\xa2ab")),
        (read, b"\xdc\x00\x2a" + 42 * (LIST_OF_99_000 + 99_000 * b"\x90")),
        (read, b"\xdc\x00\x2a" + 42 * (LIST_OF_99_000 + 99_000 * b"\x80")),
        (read, 1_000 * LIST_OF_99_000),
        (read, 1_000 * LIST_OF_99_000 + bytes(MAX_MESSAGE_BYTES - 5_000)),
        (read, (MAX_MESSAGE_BYTES - 1) * b"\x91" + b"\x90"),
        (parse_envelope, ENVELOPE + by_eights(MAX_MESSAGE_BYTES - 100) + 6 * b"\x90"),
        (parse_envelope, GOOD_ENVELOPE[:-1] + by_eights(MAX_MESSAGE_BYTES - 100)),
        (parse_envelope, GOOD_ENVELOPE[:-1] + b"\xdf\x00\x00\xff\xff" + (1 << 21) * b"\xa0\x80"),
        (parse_envelope, GOOD_ENVELOPE + bytes(MAX_MESSAGE_BYTES - 100)),
    ],
)
def test_a_message_that_would_take_much_memory_is_refused_with_little(
    take: Callable[[bytes], object], data: bytes
) -> None:
    tracemalloc.start()
    try:
        with pytest.raises((ValueError, TypeError, msgpack.UnpackException, ForgedError)):
            take(data)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < MUCH


@given(st.integers(0, 2 * LONG_BYTES), st.integers(0, SHORT_BYTES))
def test_what_is_ordinary_is_read_at_any_length(size: int, rows: int) -> None:
    message = [bytes(900)] * (size // 900) + [[row, {"name": row}] for row in range(rows)]
    assert read(msgpack.packb(message)) == message
