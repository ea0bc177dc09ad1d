"""Routers of a drill, as real processes."""

from __future__ import annotations

import signal

import psutil
import pytest

from mrbt_mesh.drills.routers import DrillRouters, RoutersError, routers

pytestmark = pytest.mark.timeout(300)


def children() -> set[int]:
    return {process.pid for process in psutil.Process().children()}


def test_they_are_killed_and_started_again_and_nothing_is_left_behind() -> None:
    before = children()
    with routers(2) as found:
        assert found is not None
        assert len(set(found.endpoints)) == 2
        assert len(children() - before) == 2
        assert found.kill(1)
        assert not found.kill(1), "it does not run any more"
        assert len(children() - before) == 1
        found.start(1)
        found.signal(2, signal.SIGSTOP)
    assert children() == before


def test_a_drill_without_routers_has_none() -> None:
    with routers(0) as found:
        assert found is None


def test_one_that_cannot_start_says_why() -> None:
    found = DrillRouters(1)
    try:
        found.start(1)
        second = DrillRouters(1)
        second.endpoints = found.endpoints
        with pytest.raises(RoutersError, match=r"router 1 has ended: .*choose another --listen"):
            second.start(1)
    finally:
        found.end()
