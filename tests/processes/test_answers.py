"""Questions reach the robot that they are for, whoever else says that he can answer them."""

from __future__ import annotations

import pytest

from mrbt_mesh.runtime.launcher import free_endpoints
from tests.support.sessions import said_by

pytestmark = pytest.mark.timeout(120)

# Who answers for everybody says that his answers are complete, so that Zenoh would rather ask him
# alone.
SESSIONS = """
import json, os, sys, threading, zenoh
from mrbt_mesh.core.agent.inputs import QueryReceived
from mrbt_mesh.core.membership.wire import MessageKind
from mrbt_mesh.runtime.zenoh_transport import TransportConfig, ZenohTransport
here = sys.argv[1]
asker = ZenohTransport(TransportConfig("team", "B1", listen=(here,)), lambda *_: False, dict().get)
asker.open()
def deliver(event, _):
    if isinstance(event, QueryReceived):
        robot.reply(event.query, (b"robot",))
robot = ZenohTransport(TransportConfig("team", "A1", connect=(here,)), deliver, dict().get)
robot.open()
def answers_with(wanted):
    while True:
        answers, end = set(), threading.Event()
        def take(event, _):
            if event.data is None:
                end.set()
            else:
                answers.add(event.data)
        asker.ask("A1", MessageKind.PULL, b"x", 2.0, take)
        end.wait()
        if wanted in answers:
            return answers
answers_with(b"robot")
config = zenoh.Config()
config.insert_json5("connect/endpoints", json.dumps([here]))
config.insert_json5("scouting/multicast/enabled", "false")
stranger = zenoh.open(config)
def answer(query):
    query.reply(query.key_expr, b"stranger")
    query.drop()
handler = zenoh.handlers.Callback(answer, indirect=False)
kept = stranger.declare_queryable("mrbt/team/pull/**", handler, complete=True)
found = answers_with(b"stranger")
sys.stdout.write(" ".join(sorted(data.decode() for data in found)))
sys.stdout.flush()
os._exit(0)
"""


def test_a_robot_is_asked_although_a_stranger_says_that_he_knows_all() -> None:
    (here,) = free_endpoints(1, "tcp")
    assert said_by(SESSIONS, here) == "robot stranger"
