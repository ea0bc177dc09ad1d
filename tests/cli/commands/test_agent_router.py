"""`mrbt router`: what it refuses, and what it writes."""

from __future__ import annotations

from pathlib import Path

import pytest
import zenoh

from mrbt_mesh.core.membership.keys import Role
from mrbt_mesh.runtime.key_folder import KeyFolder
from tests.support.command import done, mrbt, refused


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--listen", "10.0.0.1:7447"], "one of tcp/IP:PORT, tls/IP:PORT, quic/IP:PORT"),
        (["--connect", "udp/10.0.0.1:7447"], "one of tcp/IP:PORT"),
        (["--listen", "tls/10.0.0.1:7447"], "need --keys"),
        (["--keys", "nowhere"], "nowhere holds no manifest.json"),
        (["--listen", "tcp/127.0.0.1:99999"], "cannot open a Zenoh session"),
    ],
)
def test_what_cannot_be_is_explained(words: list[str], message: str) -> None:
    assert message in refused(mrbt("router", *words))


def test_a_configuration_for_zenohd_is_written_and_not_twice(tmp_path: Path) -> None:
    path = tmp_path / "zenohd.json5"
    words = ["--listen", "tcp/127.0.0.1:1", "--connect", "tcp/127.0.0.1:2"]
    assert f"zenohd -c {path}" in done(mrbt("router", *words, "--write-config", str(path)))
    config = zenoh.Config.from_file(str(path))
    assert config.get_json("mode") == '"router"'
    assert config.get_json("listen/endpoints") == '["tcp/127.0.0.1:1"]'
    assert "exists already" in refused(mrbt("router", *words, "--write-config", str(path)))


def test_with_keys_it_listens_over_tls_unless_told_otherwise(tmp_path: Path) -> None:
    keys = KeyFolder.create(tmp_path / "keys", {"A1": Role.ROBOT, "r1": Role.ROUTER})
    path = tmp_path / "zenohd.json5"
    assert mrbt("router", "--keys", str(keys.path), "--write-config", str(path))[0] == 0
    config = zenoh.Config.from_file(str(path))
    assert config.get_json("listen/endpoints") == '["tls/[::]:7447"]'
    assert '"A1 says"' in config.get_json("access_control/rules")
    assert path.stat().st_mode & 0o077 == 0
