"""Whoever reaches the robots' ports, has heard all, and says it again changed, is not believed."""

from __future__ import annotations

import json
from collections import Counter
from typing import Any

import pytest

from mrbt_mesh.core.membership.wire import MAX_MESSAGE_BYTES
from mrbt_mesh.drills.physical import spans
from tests.support.paper_run import check_paper, go_on_as_in_the_paper, hold_for_the_paper
from tests.support.sessions import intruder
from tests.support.team import EXPLORE, Team

# Reasons that `mrbt status` shows of what an intruder does (`raw_intruder`).
WRONG = {"signature is wrong"}
ATTACKS = {
    "again": {"said before"},
    "changed": WRONG,
    "incarnation": WRONG,
    "death": WRONG,
    "grant": WRONG,
    "outcome": WRONG,
    "condition": WRONG,
    "insider": WRONG
    | {
        "sent by B1 under the name of A1",
        "B1 published entries of another author",
        "sender A1 published under the key of B1",
    },
    "commands": WRONG
    | {
        "not signed",
        "screen is known as observer and may not say this",
        "B1 is known as robot and may not say this",
    },
    "large": {f"more than {MAX_MESSAGE_BYTES} bytes", "published under no robot's name"},
}


def wanted_of(team: Team, *how: str, **more: Any) -> dict[str, Any]:
    """What an intruder must know who has all keys of a team that is at work."""
    info = json.loads((team.run_dir / "run.json").read_text())
    started = team.events()[0]
    return {
        "how": how,
        "team": info["options"]["team"],
        "endpoints": list(info["endpoints"].values()),
        "keys": str(team.run_dir / "keys"),
        "activation": started["activation"],
        "local_task": started["local_task"],
        **more,
    }


def refusals(team: Team) -> dict[str, int]:
    """How often each reason is given in `mrbt status`, by all robots together."""
    found: Counter[str] = Counter()
    for counts in team.status()["refused"].values():
        for text, count in counts.items():
            found[text.partition(": ")[2]] += count
    return found


def check_repair(team: Team, *how: str, rate: int = 0) -> None:
    """A repair as in the paper in the midst of all this, which `mrbt status` shows."""
    hold_for_the_paper(team)
    team.up()
    team.wait_for_events(2, "use_screwdriver")
    keys = str(team.run_dir / "keys")
    team.mrbt("keys", "add", "screen", "--role", "observer", "--keys", keys)
    reasons = set().union(*(ATTACKS[each] for each in how))
    with intruder(**wanted_of(team, *how, rate=rate)) as process:
        team.wait_until(
            lambda: process.poll() is not None or reasons <= refusals(team).keys(),
            f"status shows {reasons}",
        )
        go_on_as_in_the_paper(team)
        code, summary = team.end()
        told, _ = process.communicate()
    assert code == 0, team.logs()
    assert int(told) > 0
    assert summary["faults"] == summary["takeovers"] == []
    check_paper(spans(team.events()))


def test_a_repair_succeeds_among_all_kinds_of_forgeries(team: Team) -> None:
    check_repair(team, *ATTACKS)


@pytest.mark.slow
@pytest.mark.parametrize("how", ATTACKS)
def test_a_repair_succeeds_among_one_kind_of_forgery(team: Team, how: str) -> None:
    check_repair(team, how)


@pytest.mark.slow
def test_a_repair_succeeds_in_a_flood(team: Team) -> None:
    check_repair(team, "changed", rate=20_000)


@pytest.mark.smoke
def test_an_order_without_the_operators_key_is_refused_and_told_so(team: Team) -> None:
    team.hold("explore")
    team.up(EXPLORE)
    team.wait_for_events(2, "explore")
    info = json.loads((team.run_dir / "run.json").read_text())
    there = team.at(
        mission=team.run_dir / "mission.json",
        team=info["options"]["team"],
        run=info["options"]["run"],
        beat=info["options"]["beat_s"],
        connect=",".join(info["endpoints"].values()),
    )
    done = there.command("abort")
    assert done.returncode == 1
    assert "signed: this team has keys" in done.stderr
    operator = team.run_dir / "keys" / "operator.key"
    operator.rename(team.folder / "operator.key")
    team.mrbt("keys", "add", "screen", "--role", "observer", "--keys", str(team.run_dir / "keys"))
    seen = team.status()
    assert seen["secure"] is True
    refused = team.command("abort")
    assert refused.returncode == 1
    assert "screen is known as observer and may not say this" in refused.stderr
    (team.folder / "operator.key").rename(operator)
    assert "abort is the team's command" in team.mrbt("abort")
    code, _ = team.end()
    assert code == 1, team.logs()
