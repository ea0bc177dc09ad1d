"""The list of a machine's runs, as far as none of them runs; the rest is in tests/browser."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import pytest
from starlette.testclient import TestClient

from mrbt_mesh.runtime.known_runs import remember
from mrbt_mesh.views.web.machine import MachineRuns
from mrbt_mesh.views.web.protection import own_names
from tests.support.run_dirs import a_run

HOST = "127.0.0.1:8000"


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> TestClient:
    """Two runs that are over; the newer one is damaged."""
    monkeypatch.setenv("MRBT_STATE_DIR", str(tmp_path / "state"))
    over = a_run(tmp_path / "over", {"R1": 0})
    over.write_summary({"result": "success"})
    remember(over)
    damaged = a_run(tmp_path / "damaged", {})
    remember(damaged)
    (damaged.path / "run.json").write_text("{")
    runs = MachineRuns(has_control=False, group=cast(Any, None))
    return TestClient(runs.application(own_names(["127.0.0.1"], 8000)), base_url=f"http://{HOST}")


def test_each_run_has_its_result_as_a_statement(machine: TestClient) -> None:
    damaged, over = machine.get("/runs?headlines").json()["runs"]
    assert damaged["headline"] == {"level": "bad", "text": "damaged"}
    assert over["headline"] == {"level": "good", "text": "success"}
    assert damaged["run"] is None, "there is no page of it"
    assert "headline" not in machine.get("/runs").json()["runs"][0]


def test_what_is_no_run_and_who_is_refused(machine: TestClient) -> None:
    assert machine.get("/run/none/").status_code == 404
    assert "default-src 'none'" in machine.get("/").headers["content-security-policy"]
    for path in ("/", "/runs", "/run/none/"):
        assert machine.get(path, headers={"host": "evil.example:8000"}).status_code == 421
    answer = machine.get("/metrics", follow_redirects=False)
    assert (answer.status_code, "run" in answer.text) == (409, True), "the newest is damaged"
