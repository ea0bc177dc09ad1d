"""Layout files: the example's, and what is said of wrong ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.adapters.vda5050.layout_file import BROKER_VARIABLE, load_layout
from mrbt_mesh.errors import InputError
from mrbt_mesh.formats.mission_file import load_mission
from tests.support.paths import EXAMPLES, mission_file
from tests.support.vda5050.plant import VEHICLES

LAYOUT = EXAMPLES / "warehouse/agvs.yaml"


def test_the_examples_layout_fits_its_mission_and_the_vehicles_of_the_tests() -> None:
    file, mission = load_layout(LAYOUT), load_mission(mission_file("warehouse"))
    assert file.addresses.keys() == mission.robots.keys() == VEHICLES.keys()
    assert file.local_tasks.keys() == mission.local_tasks.keys()
    for robot, station in VEHICLES.items():
        address, node = file.addresses[robot], file.layout.nodes[station["node"]]
        assert address.manufacturer == station["manufacturer"]
        assert address.dialect.version == station["version"]
        assert address.serial_number == robot
        assert (node.x, node.y) == (station["x"], station["y"])
    places = mission.parameters["map"]["places"]
    for name, place in places.items():
        assert [file.layout.nodes[name].x, file.layout.nodes[name].y] == place["at"]
    for start in file.layout.nodes:
        for end in file.layout.nodes:
            assert file.layout.way(start, end)
    assert file.local_tasks["count"].filled(("R3",)).sets == {"counted(R3)": True}


GOOD = """
map: hall
nodes: {A: [0, 0], B: [4, 0, 1.5]}
edges: [{from: A, to: B, both_ways: false, max_speed: 0.5}]
vehicles: {R1: {manufacturer: Acme}, R2: {manufacturer: Acme, serial_number: "7", dialect: "3.0"}}
local_tasks:
  go: {parameters: [place], stops: [{at: $place, actions: [{type: beep}]}]}
"""


def load(tmp_path: Path, text: str) -> Any:
    path = tmp_path / "agvs.yaml"
    path.write_text(text)
    return load_layout(path)


def test_what_a_short_file_means(tmp_path: Path) -> None:
    file = load(tmp_path, GOOD)
    assert file.layout.edges == {"A": {"B": 0.5}, "B": {}}
    assert file.layout.nodes["B"].theta == 1.5
    assert file.addresses["R1"].topic("state") == "uagv/v2/Acme/R1/state"
    assert file.addresses["R2"].topic("state") == "uagv/v3/Acme/7/state"
    assert (file.broker.host, file.broker.port) == ("127.0.0.1", 1883)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("to: B", "to: C", "agvs.yaml:4: edges[1]/to: unknown node 'C'"),
        ("to: B", "to: A", "an edge leads to another node, not back to A"),
        ("$place", "$plac", "local_tasks/go/stops[1]/at: unknown $plac; did you mean 'place'?"),
        ("$place", "Z", "unknown node 'Z'"),
        ("map: hall", "", "the key 'map' is missing"),
        ('"3.0"', '"2.5"', "1.1, 2.0, 2.1 or 3.0 is expected"),
        ('serial_number: "7"', "serial_number: R1", "is the same vehicle as R1"),
        ("manufacturer: Acme}", "manufacturer: a/b}", "a part of an MQTT topic is expected"),
        ("map: hall", "map: hall\nerrors: {lift: [fly]}", "unknown local task 'fly'"),
        ("map: hall", "map: hall\nbroker: {prt: 1}", "unknown key 'prt'; did you mean 'port'?"),
        ("map: hall", "map: hall\nbattery: {low_percent: 50}", "less than low_percent"),
    ],
)
def test_what_is_wrong_is_said_with_its_place(
    tmp_path: Path, old: str, new: str, said: str
) -> None:
    assert old in GOOD
    with pytest.raises(InputError) as caught:
        load(tmp_path, GOOD.replace(old, new, 1))
    assert said in str(caught.value)
    assert str(tmp_path / "agvs.yaml") in str(caught.value)


def test_the_broker_can_be_given_from_outside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(BROKER_VARIABLE, "broker.example:2883")
    broker = load(tmp_path, GOOD).broker
    assert (broker.host, broker.port) == ("broker.example", 2883)
    monkeypatch.setenv(BROKER_VARIABLE, "broker")
    with pytest.raises(InputError, match="expected host:port"):
        load(tmp_path, GOOD)


def test_a_password_comes_from_the_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = GOOD + "broker: {username: fleet, password_variable: FLEET_PASSWORD}\n"
    with pytest.raises(InputError, match="FLEET_PASSWORD"):
        load(tmp_path, text)
    monkeypatch.setenv("FLEET_PASSWORD", "secret")
    assert load(tmp_path, text).broker.password == "secret"
