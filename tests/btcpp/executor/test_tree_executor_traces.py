"""The executor against traces of the real BehaviorTree.CPP (tests/data/btcpp/README.md)."""

from __future__ import annotations

import re

import pytest

from tests.support.btcpp.conformance import Trace, traces
from tests.support.btcpp.traces import told
from tests.support.effort import at_size

# Quick runs tell each eighth.
EVERY = at_size(quick=8, gate=1)
TOLD = traces()[::EVERY]

# Nodes that yield between two attempts; an IfThenElse with two children is looked for by eye.
YIELDS = re.compile(r"Repeat|RetryUntilSuccessful|Async|SequenceWithMemory")
# As measured: in all traces, and in each eighth.
DIFFERENT = {1: 23, 8: 4}


def differs(trace: Trace, exact: bool) -> bool:
    return told(trace, exact) != (trace.shown, bool(trace.error))


def test_an_exact_tree_does_what_the_library_does() -> None:
    different = [trace.id for trace in TOLD if differs(trace, exact=True)]
    assert different == []


def test_other_trees_differ_in_the_named_oddities_alone() -> None:
    different = [trace for trace in TOLD if differs(trace, exact=False)]
    for trace in different:
        guarded = "Reactive" in trace.xml and YIELDS.search(trace.xml)
        assert guarded or "<IfThenElse>" in trace.xml, trace.xml
    assert len(different) == DIFFERENT[EVERY]


@pytest.mark.parametrize("trace", TOLD[::40], ids=lambda trace: trace.id)
def test_the_same_story_is_told_the_same_way_twice(trace: Trace) -> None:
    assert told(trace, exact=False) == told(trace, exact=False)
