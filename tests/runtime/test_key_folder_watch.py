"""A running robot takes over a newer manifest of its team, and nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.core.membership.keys import Role
from mrbt_mesh.runtime.key_folder import KeyFolder, ManifestWatch
from mrbt_mesh.runtime.member_keys import MemberKeys
from mrbt_mesh.runtime.run_dir import write_atomically

MEMBERS = {"A": Role.ROBOT, "B": Role.ROBOT}


@pytest.fixture
def folder(tmp_path: Path) -> KeyFolder:
    return KeyFolder.create(tmp_path / "keys", MEMBERS)


@pytest.fixture
def keys(folder: KeyFolder) -> MemberKeys:
    return folder.keys_of("A")


@pytest.fixture
def watch(folder: KeyFolder, keys: MemberKeys) -> ManifestWatch:
    return ManifestWatch(folder, keys)


def test_members_that_come_and_go(
    folder: KeyFolder, keys: MemberKeys, watch: ManifestWatch
) -> None:
    assert not watch.look()
    folder.add({"C": Role.ROBOT})
    assert (watch.look(), watch.problem) == (True, "")
    assert keys.role_of("C") is Role.ROBOT
    folder.revoke(["C"])
    assert (watch.look(), watch.problem) == (True, "")
    assert keys.role_of("C") is None
    assert not watch.look()
    assert not watch.is_revoked


def test_who_is_revoked_or_replaced_is_told(folder: KeyFolder, watch: ManifestWatch) -> None:
    folder.revoke(["A"])
    watch.look()
    assert watch.is_revoked


def test_an_older_version_is_refused(
    folder: KeyFolder, keys: MemberKeys, watch: ManifestWatch
) -> None:
    old = folder.manifest_path.read_text()
    folder.revoke(["B"])
    watch.look()
    write_atomically(folder.manifest_path, old)
    assert watch.look()
    assert "not newer" in watch.problem
    assert keys.role_of("B") is None


def test_another_teams_manifest_and_damage_are_refused(
    folder: KeyFolder, keys: MemberKeys, watch: ManifestWatch, tmp_path: Path
) -> None:
    other = KeyFolder.create(tmp_path / "other", {**MEMBERS, "evil": Role.OPERATOR})
    for text, problem in ((other.manifest_path.read_text(), "another team's"), ("{", "malformed")):
        write_atomically(folder.manifest_path, text)
        assert watch.look()
        assert problem in watch.problem
    assert keys.role_of("evil") is None
    folder.manifest_path.unlink()
    assert not watch.look()
