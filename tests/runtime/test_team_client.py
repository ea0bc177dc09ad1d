"""A client of a team: what it makes of requests, and what it waits for."""

from __future__ import annotations

from datetime import timedelta

import anyio
import pytest

from mrbt_mesh.core.facts.jobs import hash_of
from mrbt_mesh.core.facts.records import JobArchive
from mrbt_mesh.runtime.job_requests import JobRefusedError
from mrbt_mesh.runtime.operator_call import (
    CALL_TIMEOUT_S,
    Acknowledged,
    CommandRefusedError,
    OperatorCall,
)
from tests.support.one_robot import DeskClient


async def submitted(client: DeskClient, **more: object) -> str:
    given = {"job_id": "a", "priority": 3} | more
    return (await client.submit("inspect", "shelf_1", **given)).state  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "other",
    [
        {"priority": 4},
        {"not_before": timedelta(seconds=60)},
        {"deadline": timedelta(seconds=60)},
        {"deadline": timedelta(seconds=3_600), "priority": None},
    ],
)
def test_the_same_request_is_the_same_job_and_another_one_is_refused(
    other: dict[str, object],
) -> None:
    async def main() -> None:
        client = DeskClient()
        usual = {"deadline": timedelta(seconds=3_600)}
        assert await submitted(client, **usual) == "open"
        assert await submitted(client, **usual) == "open", "its deadline is from now, as before"
        with pytest.raises(JobRefusedError, match=r"another job of this id, a: inspect\(shelf_1\)"):
            await submitted(client, **usual | other)

    anyio.run(main)


def test_waiting_for_the_teams_clocks_takes_of_the_time_that_a_request_has(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ends_s: list[float] = []

    async def carry_out(call: OperatorCall, _: int) -> Acknowledged:
        ends_s.append(anyio.current_time() + call.timeout_s)
        return Acknowledged({"state": "open"}, ("D1",), ())

    monkeypatch.setattr(OperatorCall, "carry_out", carry_out)

    async def main() -> None:
        client = DeskClient()
        membership = client.watcher.observer.membership
        offsets_us, asked = membership.clock_offsets_us, iter(range(20))
        monkeypatch.setattr(
            membership,
            "clock_offsets_us",
            lambda: offsets_us() if next(asked, None) is None else [],
        )
        begun_s = anyio.current_time()
        await submitted(client, not_before=timedelta(seconds=60))
        assert next(asked, None) is None, "no clock was known at first"
        # A hundredth of a second for what ran between the two looks at the clock.
        assert ends_s[0] <= begun_s + CALL_TIMEOUT_S + 0.01

    anyio.run(main)


@pytest.mark.parametrize("priority", [10**9, True])
def test_a_priority_that_is_none_is_refused(priority: int) -> None:
    with pytest.raises(JobRefusedError, match="a priority is a whole number"):
        anyio.run(lambda: submitted(DeskClient(), priority=priority))


def test_arguments_are_given_in_order_or_by_name_and_not_both() -> None:
    async def main() -> None:
        client, named = DeskClient(), {"shelf": "shelf_2", "dock": "dock_1", "boxes": 3}
        assert (await client.submit("deliver", "shelf_2", "dock_1", 3, job_id="a")).state == "open"
        assert (await client.submit("deliver", arguments=named, job_id="a")).state == "open"
        listed = ["shelf_2", "dock_1", "3"]
        assert (await client.submit("deliver", arguments=listed, job_id="a")).state == "open"
        with pytest.raises(JobRefusedError, match="in order or as `arguments`, not both"):
            await client.submit("deliver", "shelf_2", arguments=named)
        with pytest.raises(JobRefusedError, match="boxes is a whole number from 1 to 4"):
            await client.submit("deliver", arguments=named | {"boxes": 5})
        with pytest.raises(JobRefusedError, match="no job type 'delivr'; did you mean 'deliver'"):
            await client.submit("delivr", arguments=named)
        (row,) = client.jobs
        assert row.arguments == named
        assert (await client.change("a", "hold"))["arguments"] == named

    anyio.run(main)


def test_the_end_of_a_job_that_ended_long_ago_is_told_at_once() -> None:
    async def main() -> None:
        client = DeskClient()
        await submitted(client)
        (job,) = client.watcher.observer.facts.jobs or ()
        assert job.job is not None
        facts = client.context.facts
        archive = JobArchive((hash_of("a"),), (job.job.content,))
        client.context.write([("job_archive/1", archive)], 0)
        facts.prune()
        again = await client.submit("inspect", "shelf_1", job_id="a", priority=3)
        assert again.state == "ended"
        assert (await again.done()).state == "ended"
        with pytest.raises(JobRefusedError, match="ended long ago; choose another id"):
            await submitted(client, priority=4)

    anyio.run(main)


def test_of_several_jobs_in_doubt_one_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    doubts = [(f"r:7@{job}:once(77)::0", f"D{number}.1") for number, job in enumerate(("o1", "o2"))]
    decided: list[str] = []

    async def command(_: object, name: str, *__: object, **___: object) -> None:
        decided.append(name.split("@")[1].split(":")[0])

    monkeypatch.setattr(DeskClient, "_in_doubt", lambda _: {"once(77)": doubts})
    monkeypatch.setattr(DeskClient, "_command", command)

    async def main() -> None:
        client = DeskClient()
        for job in ("", "o3"):
            with pytest.raises(CommandRefusedError, match="in doubt in the jobs o1, o2: name one"):
                await client.decide("once(77)", "done", job)
        assert decided == []
        await client.decide("once(77)", "done", "o2")
        assert decided == ["o2"]
        doubts.pop()
        await client.decide("once(77)", "done")
        assert decided == ["o2", "o1"]

    anyio.run(main)
