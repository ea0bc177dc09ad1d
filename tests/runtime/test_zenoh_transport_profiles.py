"""Wired and wireless: what goes with what, and what a launcher makes of it."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.formats.mission_file import compile_mission, load_mission
from mrbt_mesh.runtime import launcher
from mrbt_mesh.runtime.key_folder import KeyFolder
from mrbt_mesh.runtime.robot_options import RobotOptions
from mrbt_mesh.runtime.run_dir import Place, RunDir, RunDirError, RunInfo
from mrbt_mesh.runtime.session_config import (
    Certificates,
    TransportConfig,
    TransportError,
    session_config,
)
from mrbt_mesh.runtime.team import new_run
from mrbt_mesh.runtime.team_address import AddressError, observer_transport
from tests.support.paths import ROOT, mission_file

REPAIR = mission_file("vehicle_repair")
PLACES = {r: Place(f"198.18.0.{i}", ("enter", r)) for i, r in enumerate(("A1", "A2", "B1"), 1)}


def run(transport: str, robots: tuple[str, ...], places: dict[str, Place] | None) -> RunInfo:
    mission = load_mission(REPAIR)
    return new_run(mission, REPAIR, robots, RobotOptions(transport=transport), places=places)


def options(command: list[str], name: str) -> list[str]:
    return [e for i, word in enumerate(command) if word == name for e in command[i + 1].split(",")]


CERTIFICATES = Certificates("authority", "certificate", "private")


@pytest.mark.parametrize("endpoint", ["quic/127.0.0.1:1", "127.0.0.1:1", "udp/127.0.0.1:1"])
def test_endpoints_of_another_protocol_are_refused(endpoint: str) -> None:
    for where in ("listen", "connect"):
        with pytest.raises(TransportError, match="wired needs tcp/IP:PORT or tls/IP:PORT"):
            TransportConfig("t", "A1", **{where: (endpoint,)})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("profile", "endpoints"), [("wireless", ()), ("wired", ("tls/127.0.0.1:1",))]
)
def test_encrypted_links_need_keys(profile: str, endpoints: tuple[str, ...]) -> None:
    with pytest.raises(TransportError, match="make them with `mrbt keys init`"):
        TransportConfig("t", "A1", endpoints, profile=profile)
    TransportConfig("t", "A1", endpoints, profile=profile, certificates=CERTIFICATES)


@pytest.mark.parametrize("multicast", [None, "auto"])
@pytest.mark.parametrize(
    ("profile", "certificates", "protocol"),
    [
        ("wired", None, "tcp"),
        ("wired", CERTIFICATES, "tls"),
        ("wireless", CERTIFICATES, "quic"),
    ],
)
def test_where_no_endpoint_says_otherwise_a_session_speaks_one_protocol(
    profile: str, certificates: Certificates | None, protocol: str, multicast: str | None
) -> None:
    config = TransportConfig("t", "A1", (), (), multicast, profile, certificates)
    settings = json.loads(str(session_config(config)))
    assert settings["transport"]["link"]["protocols"] == [protocol]
    listened = settings["listen"]["endpoints"]
    assert listened == ([f"{protocol}/[::]:0"] if multicast else [])


def test_endpoints_say_which_protocols_there_are() -> None:
    config = TransportConfig(
        "t", "A1", ("tls/127.0.0.1:1",), ("tcp/127.0.0.1:2",), certificates=CERTIFICATES
    )
    assert config.protocols == ["tcp", "tls"]


def test_a_client_of_routers_has_no_other_links() -> None:
    for more in ({"listen": ("tcp/127.0.0.1:1",)}, {"multicast_interface": "lo"}):
        with pytest.raises(TransportError, match="--router makes a client"):
            TransportConfig("t", "A1", routers=("tcp/127.0.0.1:2",), **more)  # type: ignore[arg-type]
    routers = ("tcp/127.0.0.1:2", "tcp/127.0.0.1:3")
    settings = json.loads(str(session_config(TransportConfig("t", "A1", routers=routers))))
    assert settings["mode"] == "client"
    assert settings["connect"]["endpoints"] == list(routers)
    assert settings["listen"]["endpoints"] == []


def test_robots_of_a_run_are_clients_of_its_routers(tmp_path: Path) -> None:
    routers = ("tcp/127.0.0.1:2", "tcp/127.0.0.1:3")
    info = run("wired", ("A1", "A2"), None)
    shared = dataclasses.replace(info.options, routers=routers)
    info = dataclasses.replace(info, options=shared, endpoints={"A1": "", "A2": ""})
    run_dir = RunDir.create(tmp_path, info, compile_mission(load_mission(REPAIR)))
    assert RunDir.of(tmp_path).info() == info
    arguments = launcher.agent_arguments(run_dir, info, "A2")
    assert options(arguments, "--router") == list(routers)
    assert not options(arguments, "--listen")
    assert not options(arguments, "--connect")
    assert observer_transport(run_dir, info).routers == routers
    assert launcher.with_newcomer(info, "B1").endpoints["B1"] == ""


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"transport": "wireless", "insecure": True}, "wireless is encrypted"),
        ({"routers": ["tls/127.0.0.1:1"]}, "keys of their own, which no router knows"),
        ({"routers": ["quic/127.0.0.1:1"], "transport": "wireless"}, "which no router knows"),
    ],
)
def test_runs_that_cannot_be_encrypted_are_refused(options: Any, problem: str) -> None:
    mission = load_mission(REPAIR)
    with pytest.raises(AddressError, match=problem):
        new_run(mission, REPAIR, ("A1", "A2"), RobotOptions(**options))


@pytest.mark.parametrize(("transport", "protocol"), [("wired", "tcp"), ("wireless", "quic")])
def test_robots_at_places_run_there_and_listen_there(
    tmp_path: Path, transport: str, protocol: str
) -> None:
    info = run(transport, ("A1", "A2"), PLACES)
    run_dir = RunDir.create(tmp_path, info, compile_mission(load_mission(REPAIR)))
    launcher.ensure_keys(run_dir, info, "A2")
    assert RunDir.of(tmp_path).info() == info
    command = launcher.agent_command(info, "A2", launcher.agent_arguments(run_dir, info, "A2"))
    assert command[:2] == ["enter", "A2"]
    assert options(command, "--listen") == [f"{protocol}/198.18.0.2:7447"]
    assert options(command, "--connect") == [f"{protocol}/198.18.0.1:7447"]
    assert options(command, "--transport") == [transport]
    assert options(command, "--keys") == [str(run_dir.keys_path)]
    assert "--insecure" not in command
    assert sorted(KeyFolder(run_dir.keys_path).keys_of("A2").members()) == ["A1", "A2", "operator"]
    seen = observer_transport(run_dir, info)
    assert (seen.profile, seen.connect) == (transport, tuple(info.endpoints.values()))
    assert (seen.certificates is not None) == (transport == "wireless")


def test_newcomers_at_places_dial_everybody_and_need_a_place() -> None:
    info = run("wired", ("A1", "A2"), PLACES)
    joined = launcher.with_newcomer(info, "B1")
    assert joined.endpoints["B1"] == "tcp/198.18.0.3:7447"
    assert joined.dials["B1"] == ["A1", "A2"]
    replaced = launcher.with_newcomer(joined, "A1")
    assert replaced.endpoints["A1"] == "tcp/198.18.0.1:7448", "the old process holds its port"
    assert replaced.dials == {"A1": ["A2", "B1"], "A2": [], "B1": ["A2"]}
    with pytest.raises(RunDirError, match=r"no place for C1 \(only A1, A2, B1\)"):
        launcher.with_newcomer(info, "C1")


def test_a_run_on_loopback_has_ports_of_its_own() -> None:
    for transport, protocol in (("wired", "tcp"), ("wireless", "quic")):
        info = run(transport, ("A1", "A2", "B1"), None)
        hosts = [endpoint.rpartition(":")[0] for endpoint in info.endpoints.values()]
        assert hosts == [f"{protocol}/127.0.0.1"] * 3
        assert len(set(info.endpoints.values())) == 3
        newcomer = launcher.with_newcomer(info, "C1").endpoints["C1"]
        assert newcomer not in info.endpoints.values()
        assert dataclasses.replace(info, mission_name="x").places == {}


def test_a_robot_without_keys_does_without_the_library_for_them() -> None:
    code = "import sys, mrbt_mesh.runtime.robot_process; print('cryptography' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.stdout.strip() == "False", done.stderr
