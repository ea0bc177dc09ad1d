"""The stream that pages hear: everything at first, then what has changed, merged."""

from __future__ import annotations

import json
from typing import Any

import pytest

from mrbt_mesh.observer.observer import RunEnd
from mrbt_mesh.views.model.team_view import TeamView
from mrbt_mesh.views.web.feed import Feed
from tests.support.watched import WELD, watched


class Watched:
    """A scripted team and the feed of its observer, on the script's clock."""

    def __init__(self) -> None:
        self.script, observer = watched(WELD)
        self.feed = Feed(TeamView(observer), lambda: self.script.team.now_us)
        self.feed.update()

    def do(self, *commands: str) -> None:
        self.script.block(list(commands))
        self.feed.update()


def read(message: str) -> tuple[str, str, dict[str, Any]]:
    """(id, event, items)."""
    lines = dict(line.split(": ", 1) for line in message.strip().splitlines())
    return lines["id"], lines["event"], json.loads(lines["data"])["items"]


async def test_a_late_page_hears_the_past_and_then_what_is_new() -> None:
    watched = Watched()
    watched.do("kill A", "pass 1500")
    pages = watched.feed.messages("")
    _, event, items = read(await anext(pages))
    assert event == "begin"
    assert items["robot/A"]["state"] == "dead"
    assert items["fault/0"]["replacement"] == "B"
    watched.do("succeed B", "pass 1500")
    _, event, items = read(await anext(pages))
    assert event == "news"
    assert items["work/1"]["end"] == "done"
    assert "fault/0" not in items, "that has not changed"
    await pages.aclose()


async def test_the_end_of_a_run_of_which_no_robot_is_left_can_be_taken_back() -> None:
    watched = Watched()
    pages = watched.feed.messages("", ends_with_run=True)
    await anext(pages)
    watched.feed.observer.ended = RunEnd("ended", "ended by anna", 0)
    watched.do("pass 100")
    _, event, items = read(await anext(pages))
    assert (event, items["team"]["ended"]) == ("news", "ended")
    assert [read(each)[1] async for each in pages] == ["over"]
    again = [read(each)[1] async for each in watched.feed.messages("", ends_with_run=True)]
    assert again == ["begin", "over"]
    watched.feed.observer.ended = None
    watched.do("pass 100")
    pages = watched.feed.messages("", ends_with_run=True)
    _, event, items = read(await anext(pages))
    assert (event, items["team"]["ended"]) == ("begin", None)
    await pages.aclose()


async def test_a_page_that_is_slow_hears_the_newest_only() -> None:
    watched = Watched()
    pages = watched.feed.messages("")
    await anext(pages)
    for _ in range(20):
        watched.do("pass 100")
    watched.do("kill A", "pass 1500")
    watched.do("succeed B", "pass 1500")
    told = await anext(pages)
    assert told.count("\n\n") == 1
    _, _, items = read(told)
    assert items["robot/A"]["state"] == "dead"
    assert items["work/1"]["end"] == "done"
    await pages.aclose()


async def test_a_page_that_comes_back_hears_what_it_missed() -> None:
    watched = Watched()
    pages = watched.feed.messages("")
    last, _, _ = read(await anext(pages))
    await pages.aclose()
    watched.do("kill A", "pass 1500")
    again = watched.feed.messages(last)
    _, event, items = read(await anext(again))
    assert event == "news"
    assert "fault/0" in items
    assert "work/0" in items, "it has ended meanwhile"
    assert "node/0" in items, "another one works there"
    await again.aclose()


@pytest.mark.parametrize("last", ["", "other.5", "x", "..", ".", "other.-1"])
async def test_a_page_of_another_run_begins_anew(last: str) -> None:
    pages = Watched().feed.messages(last)
    assert read(await anext(pages))[1] == "begin"
    await pages.aclose()


async def test_versions_beyond_the_newest_are_the_newest() -> None:
    feed = Watched().feed
    for number in ("999999", "9" * 40, "¹"):
        pages = feed.messages(f"{feed.epoch}.{number}")
        await anext(pages)
        await pages.aclose()


async def test_the_end_is_told() -> None:
    watched = Watched()
    pages = watched.feed.messages("")
    await anext(pages)
    watched.feed.close()
    assert [read(told)[1] async for told in pages] == ["news", "over"]
    assert watched.feed.pages == 0


async def test_a_stream_of_the_run_is_over_with_its_result() -> None:
    watched = Watched()
    pages, until_closed = (watched.feed.messages("", "", None, ends) for ends in (True, False))
    await anext(pages)
    watched.do("succeed A", "pass 1500")
    assert watched.feed.observer.record.result is not None
    told = [read(each) async for each in pages]
    assert [event for _, event, _ in told] == ["news", "over"]
    assert told[0][2]["headline"][0]["text"].startswith("success"), "what is new comes before"
    assert read(await anext(until_closed))[1] == "begin"
    assert read(await anext(until_closed))[1] == "news", "a page goes on"
    await until_closed.aclose()
    later = [read(each)[1] async for each in watched.feed.messages("", "", None, True)]
    assert later == ["begin", "over"]
    last = told[-1][0]
    for count in (1, 5):
        again = [read(each)[1] async for each in watched.feed.messages(last, "", count, True)]
        assert again == ["over"]
    assert watched.feed.pages == 0
