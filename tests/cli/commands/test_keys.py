"""`mrbt keys`: a team's keys from the command line."""

from __future__ import annotations

import json
from pathlib import Path

from tests.support.command import done, mrbt, refused


def members(folder: Path) -> dict[str, str]:
    found = json.loads(done(mrbt("keys", "show", "--keys", str(folder), "--json")))["members"]
    return {n: "revoked" if m["revoked"] else m["role"] for n, m in found.items()}


def test_keys_are_made_shown_added_replaced_and_revoked(tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    output = done(mrbt("keys", "init", str(folder), "--robots", "A,B", "--observers", "eye"))
    assert output.startswith(f"made keys for A, B, operator, eye in {folder}\n")
    roles = {"A": "robot", "B": "robot", "eye": "observer", "operator": "operator"}
    assert members(folder) == roles
    assert mrbt("keys", "add", "C", "D", "--keys", str(folder))[0] == 0
    assert members(folder) == {**roles, "C": "robot", "D": "robot"}
    code, output, _ = mrbt("keys", "revoke", "C", "--keys", str(folder))
    assert (code, output) == (0, "C: revoked; version 3 of the manifest\n")
    assert members(folder) == {**roles, "C": "revoked", "D": "robot"}
    assert mrbt("keys", "add", "C", "--replace", "--keys", str(folder))[0] == 0
    assert members(folder)["C"] == "robot"
    assert "eye: observer, key " in done(mrbt("keys", "show", "--keys", str(folder)))


def test_what_cannot_be_is_said(tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    assert "A is given twice" in refused(
        mrbt("keys", "init", str(folder), "--robots", "A", "--operators", "A")
    )
    assert not folder.exists()
    mrbt("keys", "init", str(folder), "--robots", "A")
    for arguments, problem in (
        (("init", str(folder), "--robots", "A"), "holds a team's keys already"),
        (("add", "A", "--keys", str(folder)), "A has a key already"),
        (("revoke", "Z", "--keys", str(folder)), "no member 'Z'"),
        (("show", "--keys", str(tmp_path)), "holds no manifest.json"),
    ):
        code, _, problems = mrbt("keys", *arguments)
        assert (code, problem in problems) == (2, True), problems


def test_a_team_has_robots(tmp_path: Path) -> None:
    problems = refused(mrbt("keys", "init", str(tmp_path / "keys"), "--robots", ""))
    assert "--robots names none: a team has at least one robot" in problems
    assert not (tmp_path / "keys").exists()


def test_an_empty_name_is_no_member(tmp_path: Path) -> None:
    for robots in ("A,,B", "A,"):
        said = refused(mrbt("keys", "init", str(tmp_path / "keys"), "--robots", robots))
        assert "name '': 1 to 32 letters" in said
    assert not (tmp_path / "keys").exists()
