"""What the benchmark of metrics compares is the same but for the meter."""

from __future__ import annotations

from benchmarks.metrics import Talk, page_ms, ratio
from mrbt_mesh.formats.mission_file import load_mission
from tests.support.paths import mission_file

MISSION = load_mission(mission_file("explore"))


def test_the_same_inputs_with_a_meter_and_without() -> None:
    plain, metered = Talk(MISSION, False), Talk(MISSION, True)
    for talk in (plain, metered):
        talk.input_us(6_000_000)
    assert plain.meter is None
    assert plain.taken == metered.taken > 50
    views = [talk.team.agent(talk.first) for talk in (plain, metered)]
    assert all(view.agrees() and len(view.peers) == 1 for view in views)
    assert metered.meter is not None
    assert metered.meter.received.messages["heartbeat"] > 10


def test_it_measures_something() -> None:
    found = ratio(MISSION, 400)
    assert found["input_us"] > 0 < found["ratio"]
    assert page_ms(MISSION, 2) > 0
