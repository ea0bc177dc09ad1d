"""T_Li at work: its branches have the outcomes of the local tasks."""

from __future__ import annotations

import pytest

from mrbt_mesh.core.bt.tree import Status
from tests.support.script import Script

RUNNING, SUCCESS, FAILURE = Status.RUNNING, Status.SUCCESS, Status.FAILURE

TEAM = """
robot A weld
robot B look
tree Parallel(2, Fallback("weld", "look"), "look")
start A B
pass 1000
"""


@pytest.mark.parametrize(("end", "outcome"), [("fail", FAILURE), ("succeed", SUCCESS)])
def test_t_li_shows_how_a_local_task_has_ended_until_something_happens(
    end: str, outcome: Status
) -> None:
    script = Script()
    script.block(TEAM.strip().splitlines())
    robot = script.team.processes["A"].agent.view
    assert robot.statuses[3] is RUNNING
    script.block([f"{end} A"])
    heard = script.team.processes["B"].agent.view.peers["A"].heartbeat
    assert heard is not None
    # The others hear of it at once: their plan has changed as well.
    assert heard.statuses[3] == int(outcome)
    script.block(["pass 1000"])
    # It rests, which is what it is asked for, whatever it did before.
    assert (robot.claim, robot.statuses[3]) == (None, SUCCESS)
