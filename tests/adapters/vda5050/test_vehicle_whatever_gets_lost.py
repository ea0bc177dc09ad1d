"""The order of one vehicle, against a model with messages that get lost and lives that end."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.adapters.vda5050.messages import Link
from mrbt_mesh.adapters.vda5050.vehicle import AGAIN_S
from tests.support.vda5050.world import World


class Story:
    """A world to which anything may happen; each method is one thing that does."""

    def __init__(self) -> None:
        self.world = World().online()
        self.wanted = False
        self.linked = True
        self.there = True
        self.lives = 0

    def deliver(self) -> None:
        if self.linked:
            self.world.deliver()

    def lose(self) -> None:
        self.world.sent.clear()

    def drive(self) -> None:
        self.world.agv.step()

    def hear(self) -> None:
        if self.linked and self.there:
            self.world.hear()

    def wait(self) -> None:
        self.world.after(AGAIN_S)

    def start(self) -> None:
        if not self.wanted:
            self.wanted = True
            self.world.start()

    def cancel(self) -> None:
        if self.wanted:
            self.wanted = False
            self.world.take(self.world.vehicle.cancel(self.world.now_s))

    def cut(self) -> None:
        self.linked = False
        self.world.take(self.world.vehicle.unlinked(self.world.now_s))

    def link(self) -> None:
        if not self.linked:
            self.linked = self.there = True
            self.world.take(self.world.vehicle.linked(self.world.now_s))
            self.world.take(self.world.vehicle.connection(Link.ONLINE, self.world.now_s))

    def die(self) -> None:
        """The robot's process dies, and a new one begins."""
        self.lives += 1
        self.world.sent.clear()
        self.world.vehicle = self.world.born(f"S1-life{self.lives}")
        self.wanted, self.linked = False, False
        self.link()

    def broken(self) -> None:
        if self.linked:
            self.there = False
            self.world.take(self.world.vehicle.connection(Link.BROKEN, self.world.now_s))

    def back(self) -> None:
        if self.linked:
            self.there = True
            self.world.take(self.world.vehicle.connection(Link.ONLINE, self.world.now_s))


THINGS = [name for name in vars(Story) if not name.startswith("_")]


@given(st.lists(st.sampled_from(THINGS), max_size=60))
def test_whatever_gets_lost_no_order_is_driven_for_nobody(things: list[str]) -> None:
    story = Story()
    for thing in things:
        story.world.now_s += 0.1
        before = len(story.world.ended)
        getattr(story, thing)()
        # A job ends once at most, and only one that is wanted.
        assert len(story.world.ended) - before <= story.wanted
        story.wanted = story.wanted and len(story.world.ended) == before
    _settle(story.world, story.wanted, story.linked)


def _settle(world: World, wanted: bool, linked: bool) -> None:
    """From here on nothing is lost: what is wanted ends, and what is not is stopped."""
    if not linked:
        world.take(world.vehicle.linked(world.now_s))
    world.take(world.vehicle.connection(Link.ONLINE, world.now_s))
    before = len(world.ended)
    for _ in range(60):
        world.deliver()
        world.hear()
        world.after(0.5)
        is_wanted = wanted and len(world.ended) == before
        if is_wanted:
            world.agv.step()
    assert len(world.ended) - before == wanted
    assert world.vehicle.is_clear
    assert not world.agv.is_active
    assert world.fault() == ""
