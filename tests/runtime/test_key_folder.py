"""A folder of keys: made once, changed by its team key, readable by nobody else."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import pytest

from mrbt_mesh.core.membership.keys import Role
from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.key_folder import TEAM_FILE, KeyFolder, KeysError

MEMBERS = {"A": Role.ROBOT, "B": Role.ROBOT, "op": Role.OPERATOR, "eye": Role.OBSERVER}


@pytest.fixture
def folder(tmp_path: Path) -> KeyFolder:
    return KeyFolder.create(tmp_path / "keys", MEMBERS)


def test_secrets_are_their_owners_alone(folder: KeyFolder) -> None:
    secrets = [*folder.path.glob("*.key"), folder.path / TEAM_FILE]
    assert len(secrets) == len(MEMBERS) + 1
    assert {path.stat().st_mode & 0o777 for path in secrets} == {0o600}
    assert folder.path.stat().st_mode & 0o077 == 0
    for path in secrets:
        assert json.loads(path.read_text())["private"] not in folder.manifest_path.read_text()


def test_a_robots_machine_needs_two_files(folder: KeyFolder, tmp_path: Path) -> None:
    there = tmp_path / "robot"
    there.mkdir()
    for name in ("manifest.json", "A.key"):
        shutil.copy(folder.path / name, there)
    assert KeyFolder(there).keys_of("A").is_signed("B", b"x", folder.keys_of("B").sign(b"x"))
    with pytest.raises(InputError, match=r"team\.secret does not exist: change keys in the folder"):
        KeyFolder(there).add({"C": Role.ROBOT})


def test_keys_are_never_made_twice(folder: KeyFolder) -> None:
    with pytest.raises(InputError, match="holds a team's keys already"):
        KeyFolder.create(folder.path, MEMBERS)
    with pytest.raises(InputError, match="A has a key already"):
        folder.add({"A": Role.ROBOT})


def test_adding_and_replacing(folder: KeyFolder) -> None:
    before = folder.manifest()
    assert folder.add({"C": Role.ROBOT}).version == before.version + 1
    old = folder.keys_of("A").sign(b"x")
    manifest = folder.add({"A": Role.ROBOT}, replaces=True)
    assert manifest.members["A"].former == (before.members["A"].sign,)
    assert manifest.members["B"] == before.members["B"]
    keys = folder.keys_of("C")
    assert not keys.is_signed("A", b"x", old)
    assert keys.was_signed("A", b"x", old)
    assert keys.is_signed("A", b"x", folder.keys_of("A").sign(b"x"))
    with pytest.raises(InputError, match="the role of op is operator, and stays so"):
        folder.add({"op": Role.ROBOT}, replaces=True)


def test_revoking(folder: KeyFolder) -> None:
    folder.revoke(["B"])
    with pytest.raises(InputError, match="B is not a member"):
        folder.keys_of("B")
    with pytest.raises(InputError, match="no member 'Z'"):
        folder.revoke(["Z"])
    assert folder.add({"B": Role.ROBOT}, replaces=True).members["B"].former
    assert folder.keys_of("B").role_of("B") is Role.ROBOT


def test_who_watches(folder: KeyFolder) -> None:
    assert folder.reader() == "op"
    folder.revoke(["op"])
    assert folder.reader() == "eye"
    (folder.path / "eye.key").unlink()
    with pytest.raises(InputError, match="no operator's and no observer's key"):
        folder.reader()


@pytest.mark.parametrize("text", ["", "{}", '{"private": 7}', '{"private": "00"}', "\x00"])
def test_a_damaged_key_is_refused(folder: KeyFolder, text: str) -> None:
    (folder.path / "A.key").write_text(text)
    with pytest.raises(InputError, match=r"A\.key is not a private key"):
        folder.keys_of("A")


def test_a_key_that_is_not_the_manifests_is_refused(folder: KeyFolder, tmp_path: Path) -> None:
    other = KeyFolder.create(tmp_path / "other", MEMBERS)
    shutil.copy(other.path / "A.key", folder.path)
    with pytest.raises(InputError, match="another team's"):
        folder.keys_of("A")
    mine = json.loads((folder.path / "B.key").read_text())
    (folder.path / "A.key").write_text(json.dumps(mine))
    with pytest.raises(InputError, match="is not the key that"):
        folder.keys_of("A")


def test_what_is_missing_is_named(tmp_path: Path, folder: KeyFolder) -> None:
    with pytest.raises(InputError, match=r"holds no manifest\.json: name a folder that"):
        KeyFolder(tmp_path).manifest()
    with pytest.raises(InputError, match=r"Z\.key does not exist: copy it from"):
        folder.keys_of("Z")
    with pytest.raises(InputError, match="1 to 32 letters"):
        folder.add({"not a name": Role.ROBOT})


def test_routers_have_keys_and_are_none_to_whom_messages_go(folder: KeyFolder) -> None:
    folder.add({"r1": Role.ROUTER})
    assert folder.router() == "r1"
    keys = folder.keys_of("A")
    assert "r1" not in keys.members()
    assert keys.role_of("r1") is None
    assert folder.reader() == "op"
    folder.revoke(["r1"])
    with pytest.raises(InputError, match="holds no router's key: make one with `mrbt keys add`"):
        folder.router()


def test_a_key_from_before_there_were_certificates_says_what_to_do(folder: KeyFolder) -> None:
    path = folder.path / "A.key"
    data = json.loads(path.read_text())
    assert folder.certificates_of("A").certificate == data.pop("certificate")
    path.write_text(json.dumps(data))
    assert folder.keys_of("A").name == "A"
    with pytest.raises(InputError, match="mrbt keys add A --replace"):
        folder.certificates_of("A")


@pytest.mark.timeout(20)
def test_a_manifest_that_is_a_pipe_is_refused_and_nobody_is_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "manifest.json")
    with pytest.raises(KeysError, match=r"manifest\.json cannot be read: it is not a regular"):
        KeyFolder(tmp_path).manifest()


@pytest.mark.parametrize("mode", [0o666, 0o644, 0o640, 0o620, 0o602])
def test_a_private_key_that_others_can_use_is_refused(folder: KeyFolder, mode: int) -> None:
    path = folder.path / "A.key"
    path.chmod(mode)
    for read in (folder.keys_of, folder.certificates_of):
        with pytest.raises(KeysError, match=rf"by other users: `chmod 600 {path}`"):
            read("A")
    (folder.path / TEAM_FILE).chmod(mode)
    with pytest.raises(KeysError, match=rf"`chmod 600 {folder.path / TEAM_FILE}`"):
        folder.add({"Z": Role.ROBOT})
    path.chmod(0o400)
    assert folder.keys_of("A").name == "A"
    path.chmod(mode)
    assert folder.manifest().version == 1, "it is no secret"


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files to others")
def test_a_key_of_a_mounted_secret_may_be_readable_but_not_writable(folder: KeyFolder) -> None:
    """Its owner then decides who reads it, as for ssh."""
    path = folder.path / "A.key"
    os.chown(path, 1, -1)
    path.chmod(0o640)
    assert folder.keys_of("A").name == "A"
    path.chmod(0o660)
    with pytest.raises(KeysError, match="can be written by other users"):
        folder.keys_of("A")


def test_a_manifest_that_is_no_text_is_named(tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_bytes(b"\xff")
    with pytest.raises(KeysError, match=r"manifest\.json cannot be read: it is no text"):
        KeyFolder(tmp_path).manifest()


def test_what_is_said_of_keys_that_are_there_can_be_run(folder: KeyFolder) -> None:
    with pytest.raises(InputError, match="`mrbt keys show --keys "):
        KeyFolder.create(folder.path, {})
