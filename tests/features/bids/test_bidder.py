"""An agent bids, and waits for the bids of others."""

from __future__ import annotations

from mrbt_mesh.core.mission.mission import MAX_PERFORMANCE
from mrbt_mesh.features.bids.facts import bids_of
from mrbt_mesh.features.bids.messages import BidMade, BidsMade, RequestBid
from tests.support.script import Script

TEAM = """
robot A drive
robot B drive
task fetch drive 1..1 bid_within=9
tree "fetch"
start A B
"""


def test_nobody_starts_while_others_still_lack_a_bid() -> None:
    """B, the best, has all bids; A has not heard the last one, so their plans differ."""
    script = Script()
    script.block([*TEAM.replace("start A B", "robot C drive\nstart A B C").splitlines()])
    script.block(["bid A drive=-9", "cut A C", "cut B A", "bid B drive=-1"])
    told = script.block(["bid C drive=-5"])
    assert "B writes claim claimed drive" in told
    assert "starts" not in told
    later = script.block(["mend A C", "mend B A", "pass 250"])
    assert "B starts drive" in later
    assert script.team.now_us == 250_000, "before the grace time"


def test_a_bid_for_what_is_no_longer_wanted_is_not_told() -> None:
    script = Script()
    script.block(TEAM.splitlines())
    process = script.team.processes["A"]
    (asked,) = process.asked
    script.block(["operate A aborted true"])
    script.team.give(process, BidsMade((BidMade(asked.activation, asked.local_task, 5),)))
    facts = script.team.processes["A"].agent.view.facts
    assert not bids_of(facts, asked.activation).of(asked.local_task)
    other = BidMade(asked.activation, "swim", 5)
    script.team.give(process, BidsMade((other,)))
    assert not bids_of(script.team.processes["A"].agent.view.facts, asked.activation).of("swim")


def test_a_bid_beyond_all_limits_is_no_bid_and_told() -> None:
    script = Script()
    script.block(TEAM.splitlines())
    process = script.team.processes["A"]
    (asked,) = process.asked
    bid = BidMade(asked.activation, asked.local_task, 10 * MAX_PERFORMANCE)
    script.team.give(process, BidsMade((bid,)))
    assert bids_of(process.agent.view.facts, asked.activation).of(asked.local_task) == {"A": None}
    (problem,) = process.agent.view.facts.problems["A"].items()
    assert problem[0] == "bid for drive"
    assert problem[1].startswith("made no bid: integer from")


def test_what_was_asked_before_a_new_life_is_asked_again() -> None:
    script = Script()
    script.block(TEAM.splitlines())
    process = script.team.processes["A"]
    (asked,) = process.asked
    agent, now_us = process.agent, script.team.now_us + 1_500_000
    agent.handle(BidsMade(()), now_us)  # silent for so long: it takes a new life
    assert agent.view.is_joining
    late = BidsMade((BidMade(asked.activation, asked.local_task, 5),))
    assert not [e for e in agent.handle(late, now_us) if isinstance(e, RequestBid)]
    effects = []
    while agent.view.is_joining:
        now_us = agent.next_deadline_us(now_us)
        effects = agent.handle(BidsMade(()), now_us)
    assert [e.local_task for e in effects if isinstance(e, RequestBid)] == ["drive"]
