"""Ten virtual hours of every executor, with actions of minutes: nothing wears out."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim import simulate
from mrbt_mesh.sim.world.setup import AgentOptions
from tests.support.effort import at_size
from tests.support.soak import write_mission

HOURS = at_size(quick=1, gate=10)
# Few heartbeats: a robot that is alone with its work has nothing to tell.
TIMING = Timing(heartbeat_us=10_000_000, detection_us=60_000_000)
# The facts that may be left of activations that are over.
MOST_FACTS = 200


@pytest.mark.slow
def test_nothing_wears_out(tmp_path: Path) -> None:
    mission = load_mission(write_mission(tmp_path))
    found = simulate(
        mission,
        load_program(str(mission.program)),
        seed=1,
        timeout_us=HOURS * 3_600_000_000,
        inspect=False,
        agents=AgentOptions(timing=TIMING),
    )
    summary = found.summary
    assert (summary["failures"], summary["problems"], summary["faults"]) == ([], [], [])
    assert found.stops == {}
    done = Counter(e["local_task"] for e in found.events if e["outcome"] == "success")
    assert not [event for event in found.events if event["outcome"] == "failure"]
    # In an hour: a plain task and what was bid for take three minutes, and so do the tree, and two
    # tasks at places with the ways to them.
    for name in ("plain", "offered", "patrol", "at_dock", "at_field"):
        times = 20
        assert HOURS * times - 2 * HOURS <= done[name] <= HOURS * times, done
    assert all(len(agent.view.facts.map) < MOST_FACTS for agent in found.agents.values())
