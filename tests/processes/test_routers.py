"""Robots as clients of routers: real routers, agents, and sessions of intruders."""

from __future__ import annotations

import json
import signal
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import zenoh

from mrbt_mesh.core.membership.keys import Role
from mrbt_mesh.runtime.key_folder import KeyFolder
from mrbt_mesh.runtime.launcher import free_endpoints
from mrbt_mesh.runtime.router import Router, config_with_keys
from mrbt_mesh.runtime.session_config import TransportConfig, session_config
from tests.support.team import EXPLORE, Team


def started(team: Team, *options: str) -> subprocess.Popen[str]:
    """A router that routes."""
    process = team.start("router", *options)
    assert process.stdout is not None
    assert process.stdout.readline().startswith("running"), process.communicate()
    return process


def test_a_router_says_where_it_is_and_ends_when_it_is_asked_to(team: Team) -> None:
    (endpoint,) = free_endpoints(1, "tcp")
    process = team.start("router", "--listen", endpoint, "--json")
    assert process.stdout is not None
    assert json.loads(process.stdout.readline()) == {"locators": [endpoint]}
    second = team.command("router", "--listen", endpoint)
    assert second.returncode == 2
    assert endpoint in second.stderr
    assert "choose another --listen" in second.stderr
    assert "Traceback" not in second.stderr
    process.send_signal(signal.SIGTERM)
    _, said = process.communicate()
    assert process.returncode == 0, said


def test_where_no_router_is_whoever_watches_is_told_so(team: Team) -> None:
    (endpoint,) = free_endpoints(1, "tcp")
    asked = team.at(mission=EXPLORE, router=endpoint).command("status")
    assert asked.returncode == 2
    assert f"no router answers at {endpoint}" in asked.stderr


def test_teams_on_one_router_do_not_hear_each_other(team: Team) -> None:
    """The same robots, mission and run: heard by the other team, they would refuse to start.

    The robots come first, and are given a router that never comes before the one that does.
    """
    nowhere, endpoint = free_endpoints(2, "tcp")
    agents = {}
    for name in ("left", "right"):
        for robot in ("R1", "R2"):
            options = ["--team", name, "--router", f"{nowhere},{endpoint}", "--insecure"]
            options += ["--speed", "10", "--join-timeout", "60", "--exit-when-done"]
            agents[name, robot] = team.agent(EXPLORE, robot, *options)
    started(team, "--listen", endpoint)
    for (name, robot), agent in agents.items():
        _, told = agent.communicate()
        assert agent.returncode == 0, told
        assert "robot_heard" in told
        assert "refused" not in told
        # There are two areas for the two of them: nobody else's work is taken for theirs.
        assert told.count("local_task_finished") == 1, (name, robot, told)


MEMBERS = {
    "R1": Role.ROBOT,
    "R2": Role.ROBOT,
    "operator": Role.OPERATOR,
    "r1": Role.ROUTER,
    "r2": Role.ROUTER,
}


@pytest.fixture
def keys(tmp_path: Path) -> KeyFolder:
    return KeyFolder.create(tmp_path / "keys", MEMBERS)


@contextmanager
def router(keys: KeyFolder, endpoint: str, *connect: str) -> Iterator[None]:
    """A router with keys, in this process."""
    running = Router(config_with_keys(keys.path, [endpoint], connect))
    try:
        yield
    finally:
        running.close()


@contextmanager
def member(keys: KeyFolder, name: str, endpoint: str) -> Iterator[zenoh.Session]:
    """A session that shows this member's certificate."""
    profile = "wireless" if endpoint.startswith("quic") else "wired"
    certificates = keys.certificates_of(name)
    config = TransportConfig(
        "t", name, profile=profile, certificates=certificates, routers=(endpoint,)
    )
    session = zenoh.open(session_config(config))
    try:
        yield session
    finally:
        session.close()


@pytest.mark.parametrize("protocol", ["tls", "quic"])
def test_by_its_certificate_a_robot_says_only_what_is_said_under_its_name(
    keys: KeyFolder, protocol: str
) -> None:
    (endpoint,) = free_endpoints(1, protocol)
    own_keys = ("mrbt/t/to/R1/R2", "mrbt/t/beat/R2", "mrbt/t/fact/R2")
    forged_keys = ("mrbt/t/fact/R1", "mrbt/t/beat/R1", "mrbt/t/to/R1/R1", "mrbt/other", "any")
    own_token = "mrbt/t/alive/R2/1/n/z/direct"
    heard: list[str] = []
    all_its_own = threading.Event()

    def hear(sample: zenoh.Sample) -> None:
        heard.append(str(sample.key_expr))
        if {own_token, *own_keys} <= set(heard):
            all_its_own.set()

    with (
        router(keys, endpoint),
        member(keys, "R1", endpoint) as one,
        member(keys, "R2", endpoint) as two,
    ):
        one.declare_subscriber("mrbt/t/**", hear)
        one.liveliness().declare_subscriber("mrbt/t/alive/**", hear, history=True)
        token = two.liveliness().declare_token("mrbt/t/alive/R1/1/n/z/direct")
        own = two.liveliness().declare_token(own_token)
        # Until the router knows of R1's subscription it drops all that R2 says. Tokens and messages
        # may pass one another (QUIC has a stream for each), but of either kind what is forged was
        # sent first: it comes before what is its own, or not at all.
        for _ in range(600):
            for key in (*forged_keys, *own_keys):
                two.put(key, b"")
            if all_its_own.wait(0.1):
                break
        assert all_its_own.is_set(), heard
        own.undeclare()
        token.undeclare()
    assert set(heard) == {own_token, *own_keys}


def test_whoever_has_another_teams_certificate_or_none_gets_no_link(
    keys: KeyFolder, tmp_path: Path
) -> None:
    (endpoint,) = free_endpoints(1, "tls")
    strangers = KeyFolder.create(tmp_path / "strangers", MEMBERS)
    with router(keys, endpoint):
        with pytest.raises(zenoh.ZError), member(strangers, "R1", endpoint):
            pass
        bare = zenoh.Config()
        bare.insert_json5("mode", '"client"')
        bare.insert_json5("connect/endpoints", json.dumps([endpoint]))
        bare.insert_json5("connect/timeout_ms", "0")
        bare.insert_json5("scouting/multicast/enabled", "false")
        with pytest.raises(zenoh.ZError):
            zenoh.open(bare)
        with member(keys, "R1", endpoint) as session:
            assert len(list(session.info.routers_zid())) == 1


def test_a_team_with_keys_works_over_two_encrypted_routers(team: Team, keys: KeyFolder) -> None:
    """Its robots are clients of different routers, and the one of R1 dies while both work."""
    first, second = free_endpoints(2, "tls")
    start = ["--keys", str(keys.path), "--listen"]
    dying = started(team, *start, first)
    started(team, *start, second, "--connect", first)
    team.hold("explore")
    agents = []
    for robot, routers in (("R1", f"{first},{second}"), ("R2", f"{second},{first}")):
        there = team.at(keys=keys.path, team="t", router=routers)
        agents.append(there.agent(EXPLORE, robot, "--speed", "10", "--exit-when-done"))

    def living() -> int:
        there = team.at(mission=EXPLORE, keys=keys.path, team="t", router=second)
        asked = there.command("status", "--json")
        if asked.returncode != 0:
            return 0
        robots = json.loads(asked.stdout)["robots"]
        return sum(robot["state"] == "alive" for robot in robots.values())

    team.wait_until(lambda: living() == 2, "both are there")
    dying.kill()
    dying.wait()
    assert living() == 2
    team.release()
    for agent in agents:
        _, told = agent.communicate()
        assert agent.returncode == 0, told
        assert "robot_dead" not in told
        assert told.count("local_task_finished") == 1
