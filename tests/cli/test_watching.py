"""What a watch does before there is anything to watch."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from mrbt_mesh.cli import watching


def test_it_waits_for_the_first_run_of_a_machine(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    seen = [["a run"], [], []]
    monkeypatch.setattr(watching, "LOOK_S", 0)
    monkeypatch.setattr(watching, "known_runs", lambda: seen.pop())
    watching.wait_for_a_run()
    assert seen == []
    assert capsys.readouterr().err.count("no run is known here: waiting for the first one") == 1


def test_it_says_that_it_reads_a_large_recording(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    told: list[Path] = []
    monkeypatch.setattr(watching, "tell_past", lambda _, path, *__: told.append(path))
    run = SimpleNamespace(path=tmp_path)
    team: Any = SimpleNamespace(
        run_dir=run, info=SimpleNamespace(started_unix_s=0.0), living=lambda: ()
    )
    tell = watching.past_of(team)
    assert tell is not None
    tell(cast(Any, None))
    assert capsys.readouterr().err == ""
    with (tmp_path / "run.mcap").open("wb") as file:
        file.truncate(3_000_000)
    tell(cast(Any, None))
    assert "reading 3 MB of recordings" in capsys.readouterr().err
    assert told == [tmp_path, tmp_path]


@pytest.mark.parametrize(
    ("address", "public_url", "public"),
    [
        ("http://127.0.0.1:8080/", "", ""),
        ("ws://127.0.0.1:8765", "https://robots.example", ""),
        ("http://127.0.0.1:8080/", "https://robots.example", "https://robots.example/"),
        (
            "http://127.0.0.1:8080/run/a/#secret",
            "https://robots.example/depot",
            "https://robots.example/depot/run/a/#secret",
        ),
    ],
)
def test_the_address_of_a_proxy_has_the_path_and_the_token(
    address: str, public_url: str, public: str
) -> None:
    assert watching.public_address(address, public_url) == public


def test_lines_and_json_name_the_same_addresses() -> None:
    served = {"web": "http://127.0.0.1:8080/", "foxglove": "ws://127.0.0.1:8765"}
    found = watching.addresses_by_name(served, "https://robots.example")
    assert found == served | {"web_public": "https://robots.example/"}
    assert watching.address_lines(found) == [
        "web: http://127.0.0.1:8080/",
        "web, by --public-url: https://robots.example/",
        "foxglove: ws://127.0.0.1:8765",
    ]
