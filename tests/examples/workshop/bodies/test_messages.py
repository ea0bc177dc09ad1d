"""Commands and senses: what may be said, and that it arrives as it was."""

from __future__ import annotations

import contextlib
from typing import Any

import msgpack
import pytest
from bodies.messages import TOOLS, AtTip, Command, Fork, MessageError, Senses
from hypothesis import given
from hypothesis import strategies as st

numbers = st.floats(allow_nan=False, allow_infinity=False)
shares = st.lists(st.floats(0, 1), max_size=3).map(tuple)
senses = st.builds(
    Senses,
    **dict.fromkeys(("time_s", "x", "y", "heading", "forward", "left", "arm_m"), numbers),
    ranges_m=st.lists(numbers, max_size=40).map(tuple),
    at_tip=st.none() | st.builds(AtTip, st.text(max_size=9), shares, st.text(max_size=9)),
    fork=st.none() | st.builds(Fork, numbers, numbers, numbers, numbers),
)


@given(senses)
def test_senses_arrive_as_they_were(said: Senses) -> None:
    assert Senses.read(msgpack.unpackb(msgpack.packb(said.plain()))) == said


@given(st.builds(Command, *([numbers] * 6), st.sampled_from(("", *TOOLS))))
def test_commands_arrive_as_they_were(said: Command) -> None:
    assert Command.read(msgpack.unpackb(msgpack.packb(said.plain()))) == said


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ([], "a command is a mapping, not list"),
        ({"forwards": 1.0}, "a command has no forwards"),
        ({1: 2}, "a command has no 1"),
        ({"forward": "fast"}, "forward is a number, not 'fast'"),
        ({"fork_m": True}, "fork_m is a number, not True"),
        ({"turn": float("nan")}, "turn is a finite number, not nan"),
        ({"left": float("inf")}, "left is a finite number, not inf"),
        ({"tool": "hammer"}, "tool is one of unscrew, screw, probe"),
        ({"tool": ["probe"]}, "tool is one of"),
    ],
)
def test_what_is_no_command(given: Any, why: str) -> None:
    with pytest.raises(MessageError) as caught:
        Command.read(given)
    assert why in str(caught.value)


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.binary(),
        lambda inner: st.lists(inner) | st.dictionaries(st.text() | st.integers(), inner),
    )
)
def test_whatever_comes_is_a_command_or_refused(given: Any) -> None:
    with contextlib.suppress(MessageError):
        assert isinstance(Command.read(given), Command)
