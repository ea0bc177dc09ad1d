"""How routers are configured, for our own program and for Zenoh's."""

from __future__ import annotations

import json
import stat
from pathlib import Path
from typing import Any

import pytest
import zenoh

from mrbt_mesh.core.membership.keys import Role
from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.key_folder import KeyFolder, KeysError
from mrbt_mesh.runtime.router import (
    RouterConfig,
    access_control,
    as_json,
    config_with_keys,
    default_endpoint,
    router_settings,
    write_config,
)
from mrbt_mesh.runtime.session_config import TransportError, zenoh_config
from tests.support.paths import ROOT

MEMBERS = {
    "A1": Role.ROBOT,
    "B1": Role.ROBOT,
    "op": Role.OPERATOR,
    "eye": Role.OBSERVER,
    "r1": Role.ROUTER,
}


@pytest.fixture
def folder(tmp_path: Path) -> KeyFolder:
    return KeyFolder.create(tmp_path / "keys", MEMBERS)


def plain() -> RouterConfig:
    return RouterConfig((default_endpoint(has_keys=False),))


def parsed(config: zenoh.Config) -> Any:
    """As Zenoh has it, with its defaults, but for its random id."""
    return {key: value for key, value in json.loads(str(config)).items() if key != "id"}


def test_zenohs_own_router_in_deploy_is_the_same() -> None:
    shipped = zenoh.Config.from_file(str(ROOT / "deploy" / "zenohd.json5"))
    assert parsed(shipped) == parsed(zenoh_config(router_settings(plain())))


def test_the_comparison_sees_a_difference(tmp_path: Path) -> None:
    text = (ROOT / "deploy" / "zenohd.json5").read_text()
    assert "lease: 500" in text
    other = tmp_path / "other.json5"
    other.write_text(text.replace("lease: 500", "lease: 501"))
    assert parsed(zenoh.Config.from_file(str(other))) != parsed(
        zenoh_config(router_settings(plain()))
    )


def test_what_is_written_for_zenohd_is_what_runs_here(folder: KeyFolder, tmp_path: Path) -> None:
    config = config_with_keys(folder.path, ["tls/127.0.0.1:1"], ["tls/127.0.0.1:2"])
    path = tmp_path / "zenohd.json5"
    write_config(path, config)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600, "it holds the router's private key"
    written = parsed(zenoh.Config.from_file(str(path)))
    assert written == parsed(zenoh_config(router_settings(config)))
    assert written["transport"]["link"]["protocols"] == ["tls"]
    with pytest.raises(InputError, match="exists already"):
        write_config(path, config)
    with pytest.raises(InputError, match="cannot be written"):
        write_config(tmp_path / "nowhere" / "x", config)


@pytest.mark.parametrize(
    ("endpoint", "problem"),
    [
        ("10.0.0.1:7447", "one of tcp/IP:PORT, tls/IP:PORT, quic/IP:PORT is expected"),
        ("tcp/10.0.0.1", "one of tcp/IP:PORT"),
        ("udp/10.0.0.1:7447", "one of tcp/IP:PORT"),
        ("tls/10.0.0.1:7447", "need --keys"),
        ("quic/10.0.0.1:7447", "need --keys"),
    ],
)
def test_endpoints_that_cannot_be_are_explained(endpoint: str, problem: str) -> None:
    for where in ({"listen": (endpoint,)}, {"listen": ("tcp/[::]:1",), "connect": (endpoint,)}):
        with pytest.raises(TransportError, match=problem):
            RouterConfig(**where)


def test_a_router_with_keys_has_no_link_that_is_not_encrypted(folder: KeyFolder) -> None:
    with pytest.raises(TransportError, match="with --keys there are no others"):
        config_with_keys(folder.path, ["tcp/127.0.0.1:1"], [])
    settings = router_settings(config_with_keys(folder.path, ["quic/127.0.0.1:1"], []))
    assert settings["transport/link/tls"]["enable_mtls"] is True
    assert default_endpoint(has_keys=True) == "tls/[::]:7447"


def test_a_folder_without_a_routers_key_makes_no_router(tmp_path: Path) -> None:
    keys = KeyFolder.create(tmp_path / "keys", {"A1": Role.ROBOT})
    with pytest.raises(KeysError, match="holds no router's key"):
        config_with_keys(keys.path, ["tls/127.0.0.1:1"], [])


def allowed(rules: dict[str, Any], who: str, message: str) -> set[str]:
    """The keys of what this member may send to the router."""
    names = {
        rule
        for policy in rules["policies"]
        if who in policy["subjects"]
        for rule in policy["rules"]
    }
    return {
        key
        for rule in rules["rules"]
        if rule["id"] in names and message in rule["messages"] and rule["flows"] == ["ingress"]
        for key in rule["key_exprs"]
    }


def test_a_robot_may_put_only_what_is_said_under_its_name() -> None:
    rules = access_control(MEMBERS)
    assert rules["default_permission"] == "deny"
    for robot in ("A1", "B1"):
        own = {"beat", "fact", "to/*", "watch"}
        assert allowed(rules, robot, "put") == {f"mrbt/*/{place}/{robot}" for place in own}
        tokens = allowed(rules, robot, "liveliness_token")
        assert tokens == {f"mrbt/*/alive/{robot}/**"}
        answers = {f"mrbt/*/{kind}/{robot}" for kind in ("pull", "command")}
        assert (
            allowed(rules, robot, "reply") == allowed(rules, robot, "declare_queryable") == answers
        )
    for reader in ("op", "eye"):
        assert not allowed(rules, reader, "put") | allowed(rules, reader, "reply")
    assert allowed(rules, "r1", "put") == {"**"}


def test_operators_alone_command_and_all_may_ask() -> None:
    rules = access_control(MEMBERS)
    for name in ("A1", "op", "eye"):
        queries = allowed(rules, name, "query")
        assert {"mrbt/*/pull/*", "@/*/router"} <= queries
        assert ("mrbt/*/command/*" in queries) == (name == "op")


def test_who_is_revoked_may_nothing(folder: KeyFolder) -> None:
    folder.revoke(["B1"])
    settings = router_settings(config_with_keys(folder.path, ["tls/127.0.0.1:1"], []))
    assert "B1" not in json.dumps(settings["access_control"])
    assert "A1" in json.dumps(settings["access_control"])


def test_paths_become_nested_objects() -> None:
    assert json.loads(as_json({"mode": "router", "a/b": 1, "a/c/d": 2})) == {
        "mode": "router",
        "a": {"b": 1, "c": {"d": 2}},
    }
