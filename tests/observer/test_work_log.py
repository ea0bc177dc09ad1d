"""What every robot held, whichever of two messages comes first."""

from __future__ import annotations

from mrbt_mesh.core.facts.records import Claim, Outcome, Phase
from mrbt_mesh.observer.work_log import WorkEnd, WorkLog

WELD = Claim("r:0:weld::0", "weld", "weld", Phase.CLAIMED, 1)
RUNNING = Claim("r:0:weld::0", "weld", "weld", Phase.RUNNING, 1)
OTHER = Claim("r:1:lift::0", "lift", "lift", Phase.CLAIMED, 2)


def test_claimed_begun_done() -> None:
    log = WorkLog()
    log.claimed("A", WELD, 1)
    log.claimed("A", RUNNING, 2)
    log.outcome("A", WELD.activation, "weld", Outcome(True, None), 5)
    (span,) = log.spans
    assert (span.claimed_us, span.running_us, span.ended_us) == (1, 2, 5)
    assert span.end is WorkEnd.DONE


def test_the_outcome_may_be_heard_after_the_end_of_the_claim() -> None:
    log = WorkLog()
    log.claimed("A", RUNNING, 1)
    log.given_up("A", 4)
    log.outcome("A", WELD.activation, "weld", Outcome(False, None), 5)
    (span,) = log.spans
    assert (span.ended_us, span.end) == (4, WorkEnd.FAILED)


def test_another_claim_ends_the_one_before() -> None:
    log = WorkLog()
    log.claimed("A", RUNNING, 1)
    log.claimed("A", OTHER, 3)
    first, second = log.spans
    assert (first.ended_us, first.end) == (3, WorkEnd.DROPPED)
    assert second.ended_us is None


def test_death_is_told_again_when_it_is_known_better() -> None:
    log = WorkLog()
    log.claimed("A", RUNNING, 1)
    log.died("A", 9)
    log.died("A", 7)
    log.given_up("A", 12)
    (span,) = log.spans
    assert (span.ended_us, span.end) == (7, WorkEnd.DIED)


def test_the_same_task_again_is_another_span() -> None:
    log = WorkLog()
    log.claimed("A", RUNNING, 1)
    log.given_up("A", 2)
    log.claimed("A", RUNNING, 3)
    assert [span.claimed_us for span in log.spans] == [1, 3]


def test_who_held_nothing_loses_nothing() -> None:
    log = WorkLog()
    log.died("A", 1)
    log.given_up("A", 1)
    log.outcome("A", WELD.activation, "weld", Outcome(True, None), 1)
    assert not log.spans
