"""The membership benchmark: what it measures, and its tables."""

from __future__ import annotations

import pytest

from benchmarks.membership.agreement import Drill, agreement, traffic
from benchmarks.membership.declarations import declarations
from benchmarks.membership.jobs import calls
from benchmarks.membership.networks import BAD, SECOND_US, TIMING, Net, name
from benchmarks.membership.results import markdown, summary
from benchmarks.report import marks
from tests.support.paths import ROOT


def test_both_detectors_find_frozen_robots_and_only_the_plain_one_errs_on_a_bad_network() -> None:
    good, bad = declarations(3, Net(), 12, 1, seed=1), declarations(3, BAD, 60, 1, seed=1)
    for found in (good, bad):
        assert len(found.detection_us) == len(found.plain_detection_us) == 2
        assert all(0 < time_us <= TIMING.max_detection_us for time_us in found.detection_us)
    assert (good.false, good.plain_false) == (0, 0)
    assert (bad.false, bad.plain_false > 0) == (0, True)


def test_a_broken_link_is_a_death_for_the_plain_detector_alone() -> None:
    found = declarations(3, Net(links="0-1"), 20, 0, seed=1)
    assert (found.false, found.plain_false) == (0, 2)
    assert Net(links="0-1").blocked() == [(name(0), name(1)), (name(1), name(0))]
    assert Net(links="0>1").blocked() == [(name(0), name(1))]


def test_every_kind_of_event_ends_in_agreement() -> None:
    times = agreement(3, Net(), 6, seed=1)
    assert set(times) == set(Drill.KINDS)
    assert all(0 < time_us < SECOND_US for each in times.values() for time_us in each)


def test_an_event_costs_messages() -> None:
    sent = traffic(3, Net(), seed=1)
    assert sent["event_messages"] > sent["rest_messages"] > 0
    assert sent["event_kb"] > sent["rest_kb"] > 0


def test_all_that_is_run_has_its_place_in_the_tables() -> None:
    kinds = {kind for (kind, _, _), _ in calls(full=True)}
    assert kinds == {"declarations", "agreement", "traffic"}
    tables = summary(
        {
            ("declarations", 2, Net()): [declarations(2, Net(), 12, 1, 1)],
            ("declarations", 3, Net(10)): [declarations(3, Net(10), 12, 1, 1)],
            ("agreement", 3, Net()): [agreement(3, Net(), 6, 1)],
            ("traffic", 3, Net()): [traffic(3, Net(), 1)],
        }
    )
    lines = markdown(tables).splitlines()
    assert sum(line.startswith("| 3 | 0 % loss |") for line in lines) == 2
    assert sum(line.startswith("| 3 | 10 % loss | 0.2 | 0 | 0 |") for line in lines) == 1
    assert sum(line.startswith("| 2 | 0 % loss | 0.2 | 0 | 0 |") for line in lines) == 1


@pytest.mark.parametrize("page", ["membership.md", "robustness.md"])
def test_the_pages_have_a_place_for_what_is_measured(page: str) -> None:
    text = (ROOT / "docs" / "data" / page).read_text()
    assert [text.count(mark) for mark in marks()] == [1, 1]
