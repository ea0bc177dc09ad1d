"""The faulty network: what each knob does, and that a seed decides everything."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.sim.world.network import LinkKnobs, Network, NetworkKnobs

QUIET = LinkKnobs(delay_us=1_000, jitter_us=0)


def network(link: LinkKnobs, seed: int = 1) -> Network:
    return Network(NetworkKnobs(link), seed)


def test_without_faults_every_message_arrives_once_after_the_delay() -> None:
    net = network(QUIET)
    assert [net.arrivals_us("A", "B", now_us) for now_us in (0, 7, 7)] == [
        [1_000],
        [1_007],
        [1_007],
    ]


def test_jitter_stays_in_range_and_keeps_the_order_of_a_link() -> None:
    net = network(LinkKnobs(delay_us=1_000, jitter_us=5_000))
    arrivals = [net.arrivals_us("A", "B", 10 * i)[0] for i in range(200)]
    assert arrivals == sorted(arrivals)
    assert min(arrivals) >= 1_000
    assert max(arrivals) <= 10 * 199 + 6_000
    assert len(set(arrivals)) > 3


def test_reordering_lets_messages_overtake() -> None:
    net = network(LinkKnobs(delay_us=1_000, jitter_us=0, reorder_permille=300, reorder_us=5_000))
    arrivals = [net.arrivals_us("A", "B", 10 * i)[0] for i in range(200)]
    assert arrivals != sorted(arrivals)


@pytest.mark.parametrize(
    ("permille", "low", "high"), [(0, 0, 0), (200, 120, 280), (1000, 1000, 1000)]
)
def test_loss_and_duplication_happen_as_often_as_they_should(
    permille: int, low: int, high: int
) -> None:
    lossy = network(LinkKnobs(loss_permille=permille))
    doubling = network(LinkKnobs(duplicate_permille=permille))
    lost = sum(not lossy.arrivals_us("A", "B", i) for i in range(1_000))
    doubled = sum(len(doubling.arrivals_us("A", "B", i)) == 2 for i in range(1_000))
    assert low <= lost <= high
    assert low <= doubled <= high


def test_a_blocked_link_blocks_one_direction() -> None:
    net = network(QUIET)
    net.block([("A", "B")])
    assert net.arrivals_us("A", "B", 0) == []
    assert net.arrivals_us("B", "A", 0) == [1_000]
    net.unblock()
    assert net.arrivals_us("A", "B", 0) == [1_000]


def test_links_have_streams_of_their_own() -> None:
    """What happens on one link does not depend on how busy another one is."""
    link = LinkKnobs(jitter_us=5_000, loss_permille=100, duplicate_permille=100)
    alone, busy = network(link), network(link)
    expected = [alone.arrivals_us("A", "B", 10_000 * i) for i in range(50)]
    found = []
    for i in range(50):
        busy.arrivals_us("C", "B", i)
        found.append(busy.arrivals_us("A", "B", 10_000 * i))
    assert found == expected


def test_seeds_differ() -> None:
    link = LinkKnobs(jitter_us=5_000)
    runs = [[network(link, seed).arrivals_us("A", "B", 0) for _ in range(1)] for seed in range(5)]
    assert len({str(run) for run in runs}) > 1


def test_links_may_differ_and_faults_may_end() -> None:
    broken = LinkKnobs(loss_permille=1_000)
    knobs = NetworkKnobs(QUIET, {("A", "B"): broken}, quiet_from_us=500)
    net = Network(knobs, 1)
    assert net.arrivals_us("A", "B", 499) == []
    assert net.arrivals_us("B", "A", 499) == [1_499]
    assert len(net.arrivals_us("A", "B", 500)) == 1
    assert not net.is_reliable_at(499)
    assert net.is_reliable_at(500)


@pytest.mark.parametrize("wrong", [{"loss_permille": 1_001}, {"delay_us": -1}])
def test_senseless_knobs_are_refused(wrong: dict[str, int]) -> None:
    with pytest.raises(ValueError, match=r"chance|negative"):
        LinkKnobs(**wrong)


def test_links_are_disturbed_for_a_while() -> None:
    net = network(QUIET)
    net.disturb(LinkKnobs(delay_us=5_000, jitter_us=0), [("A", "B")])
    net.disturb(LinkKnobs(loss_permille=1_000))
    assert net.arrivals_us("A", "B", 0) == [5_000]
    assert net.arrivals_us("B", "A", 0) == []
    assert not net.is_reliable_at(0)
    assert net.slowest_us == 5_000
    net.settle([("A", "B")])
    assert net.arrivals_us("A", "B", 0) == []
    net.settle()
    assert net.arrivals_us("A", "B", 9_000) == [10_000]
    assert net.is_reliable_at(0)


@given(st.integers(0, 10**9), st.sampled_from((0, 500)))
def test_a_message_to_all_arrives_as_if_sent_to_each(seed: int, jitter_us: int) -> None:
    """Whether links behave alike or not, and however that changes in between."""
    knobs = NetworkKnobs(LinkKnobs(delay_us=1_000, jitter_us=jitter_us))
    together, apart = Network(knobs, seed), Network(knobs, seed)
    draw, names, now_us = random.Random(seed), ["A", "B", "C"], 0
    for number in range(60):
        now_us += draw.randrange(800)
        link = (draw.choice(names), draw.choice(names))
        quick = LinkKnobs(delay_us=draw.choice((0, 3_000)), loss_permille=draw.choice((0, 300)))
        change, links = draw.randrange(8), draw.choice(([link], None))
        for network in (together, apart):
            match change:
                case 0:
                    network.block([link])
                case 1:
                    network.unblock()
                case 2:
                    network.disturb(quick, links)
                case 3:
                    network.settle()
        if number == 30:
            names.append("D")
        source = draw.choice(names)
        expected: dict[int, list[str]] = {}
        for target in names:
            if target != source:
                for arrival_us in apart.arrivals_us(source, target, now_us):
                    expected.setdefault(arrival_us, []).append(target)
        assert together.arrivals_at_all(source, names, now_us) == expected, f"{number=}"
