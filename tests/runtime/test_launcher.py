"""What a launcher settles before robots start."""

from __future__ import annotations

import socket
import sys

import pytest

from mrbt_mesh.runtime.launcher import HOST, free_endpoints


@pytest.mark.skipif(sys.platform != "linux", reason="ports are reserved on Linux")
def test_teams_that_start_side_by_side_get_different_ports() -> None:
    """None of their robots listens yet."""
    found = [endpoint for _ in range(3) for endpoint in free_endpoints(200, "tcp")]
    assert len(set(found)) == len(found)
    with socket.socket() as robot:
        robot.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        robot.bind((HOST, int(found[0].rpartition(":")[2])))
        robot.listen()
