"""Whether a process runs, by what it wrote at its start."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import psutil
import pytest

from mrbt_mesh.runtime.process_identity import (
    identity_of_this_process,
    is_this_clock,
    process_in,
)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "R1.process"
    path.write_text(identity_of_this_process())
    return path


def found_in(file: Path) -> int:
    process = process_in(file)
    return process.pid if process is not None else 0


def test_a_process_that_runs_is_found(file: Path) -> None:
    assert found_in(file) == os.getpid()


@pytest.mark.skipif(sys.platform != "linux", reason="of Linux's time of boot")
@pytest.mark.parametrize("step_s", [-86_400, -3, 5, 3_600])
def test_a_step_of_the_clock_changes_nothing(
    file: Path, step_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    pslinux = pytest.importorskip("psutil._pslinux")
    boot_time = pslinux.boot_time
    before_s = psutil.Process().create_time()
    monkeypatch.setattr(pslinux, "boot_time", lambda: boot_time() + step_s)
    assert abs(psutil.Process().create_time() - before_s - step_s) < 1
    assert found_in(file) == os.getpid()


def test_another_process_with_its_pid_is_not_the_one(file: Path) -> None:
    data = json.loads(file.read_text())
    boot, _, ticks = data["started"].rpartition("/")
    # The process that started this one may have begun within the same tick.
    later = f"{boot}/{int(ticks) + 1}" if boot else f"{float(ticks) + 1:.2f}"
    file.write_text(json.dumps(data | {"started": later}))
    assert found_in(file) == 0


def test_nor_is_one_of_an_earlier_boot(file: Path) -> None:
    data = json.loads(file.read_text())
    file.write_text(json.dumps(data | {"started": "x" + data["started"]}))
    assert found_in(file) == 0


@pytest.mark.parametrize("text", ["", "[]", '"x"', "{}", '{"pid": "x", "started": ""}', "\xff"])
def test_a_damaged_file_names_no_process(file: Path, text: str) -> None:
    file.write_text(text, encoding="latin-1")
    assert found_in(file) == 0


def test_times_are_compared_only_if_it_is_known_that_they_are_of_one_clock(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    module = "mrbt_mesh.runtime.process_identity"
    monkeypatch.setattr(f"{module}.clock_id", lambda: "boot-1")
    assert is_this_clock("boot-1")
    assert not any(map(is_this_clock, ("boot-2", "", None, 1)))
    monkeypatch.setattr(f"{module}.clock_id", lambda: "")
    assert not is_this_clock(""), "two clocks that nobody knows need not be the same"
