"""What is said of the jobs that a team goes on with."""

from __future__ import annotations

from mrbt_mesh.cli.jobs_left_behind import open_jobs_text
from mrbt_mesh.core.observer.job_rows import JobRow


def row(name: str, state: str) -> JobRow:
    return JobRow(name, "deliver", {}, state, "", 0, (), "anna")


def test_the_open_ones_are_named_some_of_many() -> None:
    assert open_jobs_text([row("a", "succeeded")]) == ""
    rows = [row("a", "succeeded"), row("b", "waiting"), row("c", "held"), row("d", "running")]
    assert open_jobs_text(rows) == "3 jobs go on: b, c, d (`mrbt job cancel ID` takes one back)"
    many = [row(str(number), "waiting") for number in range(9)]
    assert open_jobs_text(many).startswith("9 jobs go on: 0, 1, 2, 3, 4 and 4 more (")
