"""Sessions that discover each other by multicast: the newcomer dials, and nobody else."""

from __future__ import annotations

import pytest

from mrbt_mesh.runtime.launcher import free_endpoints
from tests.support.sessions import said_by

pytestmark = pytest.mark.slow

SESSIONS = """
import os, sys, threading
from mrbt_mesh.runtime.session_config import TransportConfig, session_config, zenoh

def session(*listen):
    return zenoh.open(session_config(TransportConfig("team", "", listen, (), "lo")))

first = session(sys.argv[1])
for _ in range(5):
    newcomer = session("tcp/127.0.0.1:0")
    while not (links := [k for k in newcomer.info.links() if str(k.zid) == str(first.zid())]):
        threading.Event().wait(0.01)
    sys.stdout.write(" ".join(str(link.dst) for link in links) + "\\n")
    newcomer.close()
sys.stdout.flush()
os._exit(0)
"""


def test_a_newcomer_dials_whom_it_discovers() -> None:
    """It looks around at once; those that are there already do so only every few seconds."""
    (endpoint,) = free_endpoints(1, "tcp")
    assert said_by(SESSIONS, endpoint).split() == [endpoint] * 5
