"""Whose folders are obeyed, and who can read what a run writes."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from mrbt_mesh.core.membership.keys import Role
from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime import private_files
from mrbt_mesh.runtime.key_folder import KeyFolder
from mrbt_mesh.runtime.private_files import check_folder, private_opener
from mrbt_mesh.runtime.run_dir import RunDir, write_atomically


@pytest.mark.parametrize("mode", [0o777, 0o775, 0o757, 0o1777])
def test_a_folder_that_others_can_write_is_refused(tmp_path: Path, mode: int) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    folder.chmod(mode)
    with pytest.raises(InputError, match="can be written by other users: `chmod go-w"):
        check_folder(folder, "the run directory")


@pytest.mark.parametrize("mode", [0o700, 0o755, 0o500])
def test_one_that_others_can_read_is_taken(tmp_path: Path, mode: int) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    folder.chmod(mode)
    check_folder(folder, "the run directory")
    check_folder(tmp_path / "missing", "the run directory")


def test_one_of_another_user_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = Path.lstat

    def of_another(path: Path) -> os.stat_result:
        found = list(real(path))
        found[4] = 4_242
        return os.stat_result(found)

    monkeypatch.setattr(Path, "lstat", of_another)
    with pytest.raises(InputError, match="uid 4242"):
        check_folder(tmp_path, "the run directory")


def test_a_link_is_refused(tmp_path: Path) -> None:
    (tmp_path / "keys").symlink_to(tmp_path)
    with pytest.raises(InputError, match="is a link"):
        check_folder(tmp_path / "keys", "the folder of keys")


def test_no_planted_link_is_followed(tmp_path: Path) -> None:
    victim, planted = tmp_path / "victim", tmp_path / "planted"
    victim.write_text("precious")
    planted.symlink_to(victim)
    with pytest.raises(OSError), open(planted, "a", opener=private_opener):  # noqa: PT011
        pass
    write_atomically(planted, "new")
    assert victim.read_text() == "precious"
    assert not planted.is_symlink()


def test_what_is_written_is_for_its_owner_alone(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        write_atomically(tmp_path / "a", "text")
        with open(tmp_path / "b", "a", opener=private_opener):
            pass
        assert {(tmp_path / name).stat().st_mode & 0o777 for name in "ab"} == {0o600}
    finally:
        os.umask(before)


def test_keys_in_a_folder_that_others_can_write_are_not_used(tmp_path: Path) -> None:
    folder = KeyFolder.create(tmp_path / "keys", {"A": Role.ROBOT})
    folder.keys_of("A")
    folder.path.chmod(0o777)
    for use in (lambda: folder.keys_of("A"), lambda: folder.revoke(["A"])):
        with pytest.raises(InputError, match="written by other users"):
            use()


def test_no_run_is_found_in_a_folder_that_others_can_write(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text("{}")
    RunDir.of(tmp_path)
    tmp_path.chmod(0o777)
    with pytest.raises(InputError, match="written by other users"):
        RunDir.of(tmp_path)
    assert private_files.WRITABLE_BY_OTHERS == 0o022
