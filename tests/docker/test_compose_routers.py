"""The profile `router` of docker-compose.yml: what it says, without an engine."""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import Any

import pytest
from ruamel.yaml import YAML

from mrbt_mesh.cli.main import main
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.settings import (
    KEYS_VARIABLE,
    MISSION_VARIABLE,
    ROUTER_VARIABLE,
    TEAM_VARIABLE,
)
from tests.support.paths import ROOT

PROFILE = "router"


@pytest.fixture(scope="module")
def services() -> dict[str, Any]:
    found: dict[str, Any] = YAML(typ="safe").load(ROOT / "docker-compose.yml")["services"]
    return found


@pytest.fixture(scope="module")
def routed(services: dict[str, Any]) -> dict[str, Any]:
    """The services of the profile but for its routers."""
    found = {name: each for name, each in services.items() if each.get("profiles") == [PROFILE]}
    return {name: each for name, each in found.items() if "mrbt router" not in each["command"]}


def routers(services: dict[str, Any]) -> dict[str, Any]:
    return {n: s for n, s in services.items() if s["command"].startswith("mrbt router")}


def test_without_the_profile_nothing_of_it_starts(services: dict[str, Any]) -> None:
    always = {name for name, each in services.items() if "profiles" not in each}
    assert always == {"a1", "a2", "b1", "b2", "c1", "c2", "keys", "observer"}


def test_all_robots_of_the_mission_are_there_once(routed: dict[str, Any]) -> None:
    agents = [each for each in routed.values() if each["command"].startswith("mrbt agent")]
    mission = load_mission(ROOT / agents[0]["environment"][MISSION_VARIABLE])
    named = [each["command"].split("--robot ")[1].split()[0] for each in agents]
    assert sorted(named) == sorted(mission.robots)
    assert {each["environment"][TEAM_VARIABLE] for each in routed.values()} == {"routed"}


def test_robots_and_observer_are_clients_of_both_routers(
    services: dict[str, Any], routed: dict[str, Any]
) -> None:
    expected = [f"tcp/{name}:7447" for name in routers(services)]
    assert len(expected) == 2
    for each in routed.values():
        assert each["environment"][ROUTER_VARIABLE].split(",") == expected
        keys = PurePosixPath(each["environment"][KEYS_VARIABLE])
        assert each["volumes"] == [f"keys:{keys.parent}"]


def test_only_routers_are_on_both_networks_and_one_of_them_dials(
    services: dict[str, Any], routed: dict[str, Any]
) -> None:
    between = routers(services)
    assert all(sorted(each["networks"]) == ["left", "right"] for each in between.values())
    sides = {tuple(each["networks"]) for each in routed.values()}
    assert sides == {("left",), ("right",)}
    dialling = [each["command"] for each in between.values() if "--connect" in each["command"]]
    assert dialling == ["mrbt router --connect tcp/router1:7447"]


def test_the_commands_are_those_that_there_are(services: dict[str, Any]) -> None:
    for service, each in services.items():
        if service == "keys" or each["image"] != "mrbt-mesh":
            continue  # a line of a shell's, and other programs
        _, name, *arguments = each["command"].replace("${MRBT_SPEED:-1}", "1").split()
        command = main.get_command(None, name)  # type: ignore[arg-type]
        assert command is not None, name
        known = {text for parameter in command.params for text in parameter.opts}
        assert {word for word in arguments if word.startswith("--")} <= known
