"""A faulty network: delay, jitter, loss, duplication, reordering, partitions, routers.

All chance comes from one seed.
"""

from __future__ import annotations

import random
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

Link = tuple[str, str]
# How long a client is without a link when its router has died, as measured; in us.
FAILOVER_US = (3_000, 300_000)
# How often it tries again where no router lives.
RETRY_US = 250_000


@dataclass(frozen=True, slots=True)
class LinkKnobs:
    """How one direction between two robots behaves; times in us, chances in permille (0..1000).

    A message takes `delay_us` plus up to `jitter_us`. Messages of one link arrive in order,
    except that each is held back by up to `reorder_us` with the chance of `reorder_permille`.
    """

    delay_us: int = 1_000
    jitter_us: int = 1_000
    loss_permille: int = 0
    duplicate_permille: int = 0
    reorder_permille: int = 0
    reorder_us: int = 20_000

    def __post_init__(self) -> None:
        if min(self.delay_us, self.jitter_us, self.reorder_us) < 0:
            raise ValueError("delays cannot be negative")
        for chance in (self.loss_permille, self.duplicate_permille, self.reorder_permille):
            if not 0 <= chance <= 1_000:
                raise ValueError(f"a chance is from 0 to 1000 permille, not {chance}")

    @property
    def is_reliable(self) -> bool:
        """Whether every message arrives once."""
        return not (self.loss_permille or self.duplicate_permille)

    @property
    def slowest_us(self) -> int:
        """The longest time that a message can take."""
        held_us = self.reorder_us if self.reorder_permille else 0
        return self.delay_us + self.jitter_us + held_us


@dataclass(frozen=True)
class NetworkKnobs:
    """The whole network: `link` for all links but those in `links` (source, target).

    `token_delay_us`: how long after a process' end the others see its liveliness token go; None:
    never, as on a wireless link. `quiet_from_us`: from then on no message is lost, doubled or
    reordered; None: it goes on. A question without an answer ends after `query_timeout_us`. With
    `routers`, their names, robots are clients of these, see `routers`.
    """

    link: LinkKnobs = LinkKnobs()
    links: Mapping[Link, LinkKnobs] | None = None
    token_delay_us: int | None = 5_000
    query_timeout_us: int = 1_000_000
    quiet_from_us: int | None = None
    routers: tuple[str, ...] = ()

    @cached_property
    def is_steady(self) -> bool:
        """Whether every message arrives once, and takes as long, on all links."""
        link = self.link
        varies = link.jitter_us or link.reorder_permille or not link.is_reliable
        return not varies and not self.links and self.quiet_from_us is None

    def of(self, link: Link, now_us: int) -> LinkKnobs:
        """How one link behaves at `now_us`."""
        knobs = self.links.get(link, self.link) if self.links else self.link
        if self.quiet_from_us is not None and now_us >= self.quiet_from_us:
            return replace(knobs, loss_permille=0, duplicate_permille=0, reorder_permille=0)
        return knobs


class Network:
    """Decides when messages arrive.

    Every link and purpose has its own random stream, so that a fault at one robot leaves what
    happens between the others as it was.
    """

    def __init__(self, knobs: NetworkKnobs, seed: int) -> None:
        self.knobs = knobs
        self.blocked: set[Link] = set()
        self._disturbed: dict[Link | None, LinkKnobs] = {}
        self._slowest_us = max(each.slowest_us for each in self._usual())
        self._seed = seed
        self._streams: dict[tuple[str, Link], random.Random] = {}
        # When the last message of each link arrives, and the very last one; of links that behave
        # all alike only sender and receivers.
        self._last_us: dict[Link, int] = {}
        self._latest_us = 0
        self._sent_at_all: dict[str, tuple[int, Sequence[str]]] = {}

    def block(self, links: Iterable[Link]) -> None:
        """Let nothing pass in these directions."""
        self.blocked.update(links)

    def unblock(self, links: Iterable[Link] | None = None) -> None:
        """Let messages pass again; None: everywhere."""
        self.blocked.difference_update(set(self.blocked) if links is None else set(links))

    def disturb(self, knobs: LinkKnobs, links: Iterable[Link] | None = None) -> None:
        """Let links behave otherwise than usual from now on; None: all links."""
        self._slowest_us = max(self._slowest_us, knobs.slowest_us)
        self._disturbed.update(dict.fromkeys([None] if links is None else links, knobs))

    def settle(self, links: Iterable[Link] | None = None) -> None:
        """Let links behave as usual again; None: all links."""
        for link in list(self._disturbed) if links is None else links:
            self._disturbed.pop(link, None)

    def is_reliable_at(self, now_us: int) -> bool:
        """Whether no link loses or doubles messages any more."""
        quiet_us = self.knobs.quiet_from_us
        usual = (quiet_us is not None and now_us >= quiet_us) or all(
            knobs.is_reliable for knobs in self._usual()
        )
        return usual and all(knobs.is_reliable for knobs in self._disturbed.values())

    @property
    def slowest_us(self) -> int:
        """The longest time that a message can take, or could since the start, on any link."""
        return self._slowest_us

    def _usual(self) -> tuple[LinkKnobs, ...]:
        return (self.knobs.link, *(self.knobs.links or {}).values())

    def arrivals_at_all(
        self, source: str, targets: Iterable[str], now_us: int
    ) -> dict[int, list[str]]:
        """When a message that is sent to many now arrives, and where; never at the source."""
        others = [target for target in targets if target != source]
        arrival_us = now_us + self.knobs.link.delay_us
        is_usual = self.knobs.is_steady and not (self._disturbed or self.blocked)
        if is_usual and arrival_us >= self._latest_us:
            self._sent_at_all[source] = arrival_us, others
            self._latest_us = arrival_us
            return {arrival_us: others}
        found: dict[int, list[str]] = {}
        for target in others:
            for arrival_us in self.arrivals_us(source, target, now_us):
                found.setdefault(arrival_us, []).append(target)
        return found

    def _knobs_of(self, link: Link, now_us: int) -> LinkKnobs:
        if not self._disturbed:
            return self.knobs.of(link, now_us)
        everywhere = self._disturbed.get(None)
        return self._disturbed.get(link) or everywhere or self.knobs.of(link, now_us)

    def arrivals_us(self, source: str, target: str, now_us: int) -> list[int]:
        """When a message that is sent now arrives: never, once, or twice."""
        link = (source, target)
        if link in self.blocked:
            return []
        knobs = self._knobs_of(link, now_us)
        if knobs.loss_permille and self._happens("loss", link, knobs.loss_permille):
            return []
        arrival_us = self._arrival_us(link, knobs, now_us)
        if knobs.duplicate_permille and self._happens("duplicate", link, knobs.duplicate_permille):
            return [arrival_us, self._arrival_us(link, knobs, now_us)]
        return [arrival_us]

    def _arrival_us(self, link: Link, knobs: LinkKnobs, now_us: int) -> int:
        arrival_us = now_us + knobs.delay_us
        if knobs.jitter_us:
            arrival_us += self._stream("jitter", link).randrange(knobs.jitter_us + 1)
        if knobs.reorder_permille and self._happens("reorder", link, knobs.reorder_permille):
            return arrival_us + self._stream("hold", link).randint(0, knobs.reorder_us)
        return self._in_order_us(link, arrival_us)

    def _in_order_us(self, link: Link, arrival_us: int) -> int:
        last_us = self._last_us.get(link, 0)
        sent_us, targets = self._sent_at_all.get(link[0], (0, ()))
        if arrival_us < sent_us and link[1] in targets:
            last_us = max(last_us, sent_us)
        if arrival_us < last_us:
            return last_us
        self._last_us[link] = arrival_us
        self._latest_us = max(self._latest_us, arrival_us)
        return arrival_us

    def _happens(self, purpose: str, link: Link, permille: int) -> bool:
        return self._stream(purpose, link).randrange(1_000) < permille

    def _stream(self, purpose: str, link: Link) -> random.Random:
        stream = self._streams.get((purpose, link))
        if stream is None:
            # Seeded by text: the same on every machine and under every hash seed.
            stream = random.Random(f"{self._seed}/{purpose}/{link[0]}>{link[1]}")
            self._streams[purpose, link] = stream
        return stream


class Routers:
    """The routers of one run by name; none: robots have links of their own.

    A robot is a client of one router at a time. When that dies, its link is lost, and with it all
    that is sent to it and by it; a moment later it is linked to the next router that lives.
    `of`: robot -> the router that it is linked to.
    """

    def __init__(self, names: Iterable[str], seed: int) -> None:
        self.names = tuple(names)
        self.of: dict[str, str] = {}
        self._dead: set[str] = set()
        self._random = random.Random(f"{seed}/routers")

    def link(self, robot: str) -> bool:
        """Link a robot to a router; False if none lives.

        Real ones take the first that answers. Here it is any, for more varied runs.
        """
        living = [name for name in self.names if name not in self._dead]
        if living:
            self.of[robot] = self._random.choice(living)
        return bool(living)

    def unlink(self, robot: str) -> None:
        """Its process has ended."""
        self.of.pop(robot, None)

    def end(self, router: str) -> dict[str, int]:
        """A router dies: its clients, sorted, and how long each is without a link at least."""
        self._dead.add(router)
        clients = sorted(robot for robot, name in self.of.items() if name == router)
        for robot in clients:
            del self.of[robot]
        return {robot: self._random.randint(*FAILOVER_US) for robot in clients}

    def begin(self, router: str) -> None:
        """A router is there again."""
        self._dead.discard(router)

    def reaches(self, robot: str) -> bool:
        """Whether a robot is linked to a router, or needs none."""
        return not self.names or robot in self.of

    def is_linked(self, robot: str, router: str) -> bool | None:
        """Whether this router is linked to a robot; None if it is dead."""
        return None if router in self._dead else self.of.get(robot) == router
