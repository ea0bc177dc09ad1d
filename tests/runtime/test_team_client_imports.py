"""What a client of a team does not load: short commands attach, ask and end."""

from __future__ import annotations

import subprocess
import sys

# The packages of YAML files, solvers, keys, recordings and screens.
PACKAGES = {
    *("pydantic", "pydantic_core", "ruamel", "numpy", "ortools", "cryptography"),
    *("sqlite3", "rich", "textual", "psutil"),
}
# A robot itself, the launcher of robots, what records.
PARTS = {
    *(f"mrbt_mesh.core.agent.{name}" for name in ("context", "commands", "operator_desk")),
    *(f"mrbt_mesh.runtime.{name}" for name in ("team", "launcher", "journal", "user_code")),
    *(f"mrbt_mesh.recording.{name}" for name in ("channels", "recorder", "reader", "writer")),
    *("mrbt_mesh.runtime.recording", "mrbt_mesh.runtime.observer_recording"),
}


def test_a_client_loads_no_part_of_a_robot_and_nothing_that_records() -> None:
    code = "import sys, mrbt_mesh.runtime.team_client; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert {"zenoh", "anyio", "mrbt_mesh.core.agent.operator_messages"} <= loaded
    assert not PARTS & loaded
    assert not PACKAGES & {name.partition(".")[0] for name in loaded}
