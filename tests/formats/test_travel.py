"""Places, ways and where local tasks happen, in mission files."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.core.mission.compiled import mission_from_compiled
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.travel import Travel
from mrbt_mesh.core.scheduling.problem import Objective
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.formats.mission_file import FileError, compile_mission, load_mission
from tests.support.paths import ROOT

# Line numbers below count from the first line of this text, which is line 1.
DEPOT = """\
mission: depot
parameters:
  shelves: [1, 2]
  map:
    places:
      dock: {at: [0, 0]}
      shelf_1: {at: [3, 4]}
      shelf_2: {at: [0.5, -2]}
travel:
  places: {dock: [0, 0], gate: [1, 0], shelf_1: [3, 4], shelf_2: [0.5, -2]}
  speed: {cart: 0.5}
  ways: {dock: {shelf_2: 12.5, shelf_1: 0.0005}, shelf_2: {dock: 6}}
  start: {A1: dock, A2: gate}
local_tasks:
  lift: {parameters: [shelf], at: shelf_$shelf}
  call: {}
  carry: {parameters: [to], at: $to}
robot_types:
  cart: {capabilities: {lift: 1, carry: 1}}
  server: {capabilities: {call: 1}}
robots: {A1: cart, A2: cart, S1: server}
global_tasks:
  fetch: {parameters: [shelf], needs: {lift($shelf): {}}}
  bring: {needs: {carry(gate): {}, call: {}}}
tree: {Sequence: [{Parallel: {for_each: {s: $shelves}, do: fetch($s)}}, bring]}
"""
READ = Travel(
    {
        "dock": (0, 0),
        "gate": (1_000_000, 0),
        "shelf_1": (3_000_000, 4_000_000),
        "shelf_2": (500_000, -2_000_000),
    },
    {"carry(gate)": "gate", "lift(1)": "shelf_1", "lift(2)": "shelf_2"},
    {"A1": "dock", "A2": "gate"},
    {"cart": 500_000},
    {("dock", "shelf_2"): 12_500, ("dock", "shelf_1"): 1, ("shelf_2", "dock"): 6_000},
)


def load(text: str) -> Mission:
    return mission_from_yaml(text, "m.yaml", Path("/nowhere"))


def changed(*changes: tuple[str, str]) -> str:
    text = DEPOT
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


PLACES = "{dock: [0, 0], gate: [1, 0], shelf_1: [3, 4], shelf_2: [0.5, -2]}"
SPEED = "speed: {cart: 0.5}"
WAYS = "ways: {dock: {shelf_2: 12.5, shelf_1: 0.0005}, shelf_2: {dock: 6}}"
START = "start: {A1: dock, A2: gate}"


def test_they_are_read_and_survive_compiling() -> None:
    mission = load(DEPOT)
    assert mission.travel == READ
    again = mission_from_compiled(compile_mission(mission), "m.json")
    assert again == mission
    assert again.digest == mission.digest != load(changed((SPEED, "speed: {cart: 1}"))).digest


def test_other_ways_to_say_it() -> None:
    rest = "start: dock\n  objective: mean_completion\n  way_back: start\n  horizon: 7"
    found = load(
        changed((PLACES, "map"), (SPEED, "speed: 2"), (START, rest), ("y(gate)", "y(dock)"))
    )
    assert found.travel == Travel(
        {name: at for name, at in READ.places.items() if name != "gate"},
        {"carry(dock)": "dock", "lift(1)": "shelf_1", "lift(2)": "shelf_2"},
        {"A1": "dock", "A2": "dock", "S1": "dock"},
        {"cart": 2_000_000, "server": 2_000_000},
        READ.ways_ms,
        Objective.MEAN_COMPLETION,
        True,
        7,
    )


def test_a_table_of_ways_needs_neither_coordinates_nor_speeds() -> None:
    rows = "gate: {shelf_1: 3, shelf_2: 4}, shelf_2: {dock: 0, shelf_1: 9}"
    table = f"ways: {{dock: {{gate: 1, shelf_1: 2}}, {rows}}}"
    text = changed((f"  places: {PLACES}\n", ""), (f"  {SPEED}\n", ""), (WAYS, table))
    mission = load(text)
    assert mission.travel is not None
    assert mission.travel.places == dict.fromkeys(("dock", "gate", "shelf_1", "shelf_2"))
    assert mission.travel.way_ms("cart", "shelf_1", "shelf_2") == 9_000
    assert mission_from_compiled(compile_mission(mission), "m.json") == mission


def test_only_what_the_tree_asks_for_has_a_place() -> None:
    text = changed(
        ("tree: {Seq", "tree: bring\nsubtrees: {rest: {tree: {Seq"), ("}, bring]}", "}, bring]}}}")
    )
    assert load(text).travel == replace(READ, at={"carry(gate)": "gate"})
    text = changed(
        (
            "tree: {Sequence: [{Parallel: {for_each: {s: $shelves}, do: fetch($s)}}, bring]}",
            "tree: bring",
        ),
        ("carry(gate): {}, ", ""),
    )
    assert load(text).travel is None


def test_a_mission_without_places_says_nothing_of_them() -> None:
    plain = load_mission(ROOT / "examples" / "explore" / "mission.yaml")
    assert "travel" not in plain.to_json()


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("travel:", "travle:", 9, "unknown key 'travle'; did you mean 'travel'?"),
        (f"  {START}\n", "", 9, "travel: the key 'start' is missing"),
        (PLACES, "maps", 10, "map is expected, found the text 'maps'"),
        (PLACES, "3", 10, "map, or {dock: [0, 0], shelf: [3.5, 4]} is expected"),
        ("gate: [1, 0]", "gate: [1]", 10, "places/gate: at least 2 expected, found 1"),
        ("gate: [1, 0]", "gate: [1, far]", 10, "a number is expected, found the text 'far'"),
        ("gate: [1, 0]", "gate: [1, 1e10]", 10, "a number of at most 1e+09 is expected"),
        ("gate: [1, 0]", "gate: [1, 0.0000001]", 10, "at most 6 decimals is expected"),
        ("gate: [1, 0]", "the gate: [1, 0]", 10, "a place is expected: 1 to 64 letters, digits"),
        ("gate: [1, 0]", "gate: [1, 0], gate: [2, 0]", 10, "'gate' is given twice, first on line"),
        (SPEED, "speed: 0", 11, "a number above 0 is expected, found the number 0"),
        (SPEED, "speed: fast", 11, "a number, or {cart: 0.5, drone: 2} is expected"),
        (SPEED, "speed: {cat: 1}", 11, "unknown robot type 'cat'; did you mean 'cart'?"),
        (
            SPEED,
            "speed: {server: 1}",
            12,
            "cart has no way from dock to gate; add it to ways, or give cart a speed",
        ),
        (SPEED, "speed: 0.000001", 12, "cart needs more than 1000000 s between the places"),
        ("shelf_1: 0.0005", "shelf_1: -1", 12, "a number of at least 0 is expected, found the"),
        ("shelf_1: 0.0005", "shelf_1: 2000000", 12, "a number of at most 1e+06 is expected"),
        (
            "shelf_1: 0.0005",
            "shelf_3: 1",
            12,
            "'shelf_3' is not a declared place; did you mean 'shelf_2'?",
        ),
        ("shelf_1: 0.0005", "dock: 1", 12, "this is a way to where it begins; remove it"),
        (
            WAYS,
            "ways: {gates: {dock: 1}}",
            12,
            "'gates' is not a declared place; did you mean 'gate'?",
        ),
        (START, "start: docks", 13, "'docks' is not a declared place; did you mean 'dock'?"),
        (START, "start: 1", 13, "a place (a number in quotes), or {A1: dock, A2: shelf} is"),
        (START, "start: {A1: dock, A3: dock}", 13, "no robot 'A3'; known: A1, A2, S1"),
        (START, "start: {A1: dock}", 13, "A2 can work at places; say where it is at first"),
        (START, f"{START}\n  objective: soon", 14, "makespan or mean_completion is expected"),
        (START, f"{START}\n  way_back: home", 14, "none or start is expected, found the text"),
        (START, f"{START}\n  horizon: 0", 14, "a number of at least 1 is expected"),
        ("at: $to", "at: to", 17, "'to' is not a place; write $to for the parameter"),
        ("at: $to", "at: gates", 17, "'gates' is not a declared place; did you mean 'gate'?"),
        ("at: $to", "at: $too", 17, "unknown parameter $too; did you mean 'to'?"),
        ("at: $to", "at: shelf_$", 17, "a place is expected, e.g. dock, $place or shelf_$number"),
        (
            "at: $to",
            "at: $shelves",
            17,
            "carry(gate): an argument is text or a number, found a list",
        ),
        (
            "shelves: [1, 2]",
            "shelves: [1, 3]",
            15,
            "lift(3): 'shelf_3' is not a declared place; did",
        ),
    ],
)
def test_a_mistake_is_named_with_its_line(old: str, new: str, line: int, message: str) -> None:
    assert_refused(changed((old, new)), line, message)


@pytest.mark.parametrize(
    ("changes", "line", "message"),
    [
        ([("dock: {at", "the dock: {at")], 6, "arguments name places, but an argument has 1 to 64"),
        ([("[3, 4]}\n", "[3, 0.0000001]}\n")], 7, "at most 6 decimals is expected"),
        ([("places:\n", "spots:\n")], 10, "parameters: map has no places with coordinates"),
    ],
)
def test_a_mistake_on_the_map_is_named_with_its_line(
    changes: list[tuple[str, str]], line: int, message: str
) -> None:
    assert_refused(changed((PLACES, "map"), *changes), line, message)


def test_places_and_local_tasks_at_places_belong_together() -> None:
    travel = DEPOT[DEPOT.index("travel:") : DEPOT.index("local_tasks:")]
    message = "travel is missing, which declares places, e.g. travel: {places: {dock: [0, 0]}"
    assert_refused(changed((travel, "")), 10, message)
    without = changed((", at: shelf_$shelf", ""), (", at: $to", ""))
    assert_refused(without, 9, "travel: no local task happens at a place; give one, e.g. at: $")
    without = changed((f"  places: {PLACES}\n", ""), (f"  {WAYS}\n", ""))
    assert_refused(without, 9, "1 to 1000 places are expected, found 0; give places: {dock: [0")
    table = "ways: {dock: {gate: 1, shelf_1: 2, shelf_2: 3}}"
    without = changed((f"  places: {PLACES}\n", ""), (WAYS, table))
    message = (
        "cart has no way from gate to shelf_1; add it to ways, or give both places coordinates"
    )
    assert_refused(without, 11, message)


def assert_refused(text: str, line: int, message: str) -> None:
    with pytest.raises(FileError) as caught:
        load(text)
    found = [(each.line, str(each)) for each in caught.value.problems]
    assert any(at == line and message in said for at, said in found), found


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("d['places']['gate'] = [1, 0.5]", "travel.places.gate.1: a whole number expected"),
        ("d['places']['gate'] = [1]", "travel.places.gate: a list of 2 expected"),
        ("d['places']['gate'] = 0", "travel.places.gate: a list expected"),
        ("d['speeds']['cart'] = 0", "speeds"),
        ("d['speeds'].clear()", "cart has no way from dock to gate"),
        ("d['ways_ms'][0][1] = -1", "way ('dock', 'shelf_1')"),
        ("d['ways_ms'].append(d['ways_ms'][0])", "travel.ways_ms: a key is given twice"),
        ("d['at']['lift(9)'] = 'gate'", "places of local tasks"),
        ("d['at']['lift(1)'] = 'yard'", "place 'yard'"),
        ("d['start']['Z'] = 'gate'", "places of robots"),
        ("d['start'].pop('A1')", "A1 can work at places"),
        ("d['has_way_back'] = 1", "travel.has_way_back: true or false expected"),
        ("d['horizon'] = 0", "horizon 0"),
    ],
)
def test_a_damaged_compiled_mission_is_refused(change: str, message: str) -> None:
    data: dict[str, Any] = json.loads(compile_mission(load(DEPOT)))
    exec(change, {"d": data["travel"]})
    with pytest.raises(FileError) as caught:
        mission_from_compiled(json.dumps(data), "m.json")
    assert message in str(caught.value)
