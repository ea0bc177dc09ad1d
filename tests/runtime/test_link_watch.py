"""Which links are silent, which are split: what one robot sees of another, second by second."""

from __future__ import annotations

from mrbt_mesh.runtime.link_watch import LinkEvent, LinkWatch, Sighting

SECOND_US = 1_000_000
LEASE_US = 2 * SECOND_US
TICK_US = SECOND_US // 4
UP = LinkEvent("link_up", "B1", 0)


class Story:
    """Looks at one robot (and others) four times a second."""

    def __init__(self, rank: int = 0) -> None:
        self.watch = LinkWatch(LEASE_US)
        self.now_us = 10 * SECOND_US
        self.heard_us = self.news_us = self.now_us
        self.rank = rank
        self.events: list[LinkEvent] = []
        self.splits: list[float] = []

    def goes(self, seconds: float, *, beats: bool, news: bool, linked: bool = True) -> Story:
        for _ in range(round(seconds * SECOND_US / TICK_US)):
            self.now_us += TICK_US
            if beats:
                self.heard_us = self.now_us
            if beats or news:
                self.news_us = self.now_us
            links = {"B1": Sighting(self.heard_us, self.news_us, linked)}
            self.events += self.watch.look(links, self.now_us)
            if self.watch.split(links, self.rank, self.now_us) is not None:
                self.splits.append(self.now_us / SECOND_US - 10)
                self.watch.reopened(self.now_us)
        return self


def test_a_link_that_beats_is_never_told() -> None:
    story = Story().goes(60, beats=True, news=True)
    assert (story.events, story.splits) == ([UP], [])


def test_silence_of_a_lease_is_told_once_and_so_is_the_return() -> None:
    story = Story().goes(5, beats=False, news=True, linked=False).goes(5, beats=True, news=True)
    assert story.events == [
        UP,
        LinkEvent("link_silent", "B1", LEASE_US),
        LinkEvent("link_heard", "B1", 5 * SECOND_US + TICK_US),
    ]
    assert story.splits == [], "no transport, no split: it will be dialled again"


def test_a_transport_without_beats_is_split_if_others_have_news() -> None:
    story = Story().goes(4.5, beats=False, news=True)
    assert story.splits == [4.5], "two leases after the first silent look"
    assert story.goes(10, beats=True, news=True).splits == [4.5]


def test_a_link_that_has_just_come_back_is_given_time() -> None:
    story = Story().goes(30, beats=False, news=True, linked=False)
    assert story.goes(3, beats=False, news=True).goes(3, beats=True, news=True).splits == []


def test_a_robot_of_which_nobody_has_news_probably_hangs_and_is_waited_for() -> None:
    hanging = Story().goes(9.5, beats=False, news=False).goes(9, beats=True, news=True)
    assert hanging.splits == []
    assert Story().goes(11, beats=False, news=False).splits == [10.5]
    assert Story(rank=3).goes(14, beats=False, news=False).splits == [13.5], "not all at once"


def test_reopening_in_vain_becomes_rarer() -> None:
    story = Story().goes(120, beats=False, news=True)
    pauses = [b - a for a, b in zip(story.splits, story.splits[1:], strict=False)]
    assert pauses == [4.25, 8.0, 16.0, 32.0]
    story.goes(60, beats=True, news=True).splits.clear()
    story.goes(10, beats=False, news=True)
    assert len(story.splits) == 2, "what is over is forgotten"


def test_robots_that_are_no_neighbours_any_more_are_forgotten_and_reported_if_silent() -> None:
    watch = LinkWatch(LEASE_US)
    silent = Sighting(0, 0, True)
    for beats in range(0, 3 * LEASE_US, TICK_US):
        watch.look({"B1": silent, "C1": Sighting(beats, beats, True)}, beats)
    events = watch.look({}, 3 * LEASE_US)
    assert events == [LinkEvent("link_unwatched", "B1", 3 * LEASE_US)]
    assert watch.look({}, 3 * LEASE_US) == []
    assert watch.split({}, 0, 3 * LEASE_US) is None
