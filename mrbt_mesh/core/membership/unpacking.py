"""Messages taken apart, in a few times their own memory, whatever they say.

An empty list takes a byte in a message, and 64 in memory: so a long message may have only so many
items. A list takes memory for as many items as it announces, before any of them is there: so all
but a short message is first gone through without keeping anything.
"""

from __future__ import annotations

from typing import Any

import msgpack

# Items of one list, and of all lists of a message together.
MAX_ITEMS, MAX_ALL_ITEMS = 100_000, 300_000
SHORT_BYTES, LONG_BYTES = 4 << 10, 64 << 10


def unpacked(data: bytes, longest: int) -> Any:
    """A message as plain data, in which no text or binary data is longer than `longest`.

    Raises ValueError, TypeError or msgpack.UnpackException for anything else.
    """
    if len(data) > SHORT_BYTES:
        unpacker = msgpack.Unpacker(max_buffer_size=len(data))
        unpacker.feed(data)
        unpacker.skip()
    items = 0

    def count(found: Any) -> Any:
        nonlocal items
        items += len(found)
        if items > MAX_ALL_ITEMS:
            raise ValueError(f"more than {MAX_ALL_ITEMS} items")
        return found

    is_long = len(data) > LONG_BYTES
    return msgpack.unpackb(
        data,
        list_hook=count if is_long else None,
        object_hook=count if is_long else None,
        max_str_len=longest,
        max_bin_len=longest,
        max_array_len=min(MAX_ITEMS, len(data)),
        max_map_len=min(MAX_ITEMS, len(data)),
        max_ext_len=0,
    )
