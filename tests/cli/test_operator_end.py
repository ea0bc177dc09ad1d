"""A run that was blocked before an operator ended it stays blocked; else it is ended by him."""

from __future__ import annotations

import pytest

from mrbt_mesh.cli.operator_end import with_operator_end
from mrbt_mesh.core.observer.episodes import BlockedEpisode
from mrbt_mesh.core.observer.run_record import RunRecord
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.fencing import boottime_us
from tests.support.paths import mission_file

SECOND_US = 1_000_000


@pytest.mark.parametrize(
    ("before", "ago_s", "result"),
    [("blocked", 60, "blocked"), ("blocked", 0, "ended"), ("timeout", None, "ended")]
    + [(each, None, each) for each in ("success", "failure", "not_started")],
)
def test_what_was_in_the_way_before_stays_said(before: str, ago_s: int | None, result: str) -> None:
    record = RunRecord(load_mission(mission_file("explore")))
    if ago_s is not None:
        record.blocked.append(BlockedEpisode("explore", "why", boottime_us() - ago_s * SECOND_US))
    found = with_operator_end({"result": before}, record, None, "stopped by the operator")
    assert (found["result"], found["ended_because"]) == (result, "stopped by the operator")


def test_nobody_has_ended_it() -> None:
    record = RunRecord(load_mission(mission_file("explore")))
    assert with_operator_end({"result": "timeout"}, record, None, "") == {"result": "timeout"}
