"""The results of many random runs, for people."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from mrbt_mesh.cli.printing import Printable, Stack, Styled
from mrbt_mesh.cli.terminal import table
from mrbt_mesh.sim.chaos.campaign import CRASH

INVARIANTS = {
    "I1": "same facts, same plan",
    "I2": "facts converge, nobody is dead who is heard",
    "I3": "nothing done is undone",
    "I4": "nobody beyond its means, bounds hold",
    "I5": "an exclusive task has one coalition",
    "I6": "what can be finished is finished",
    "I7": "assignments optimal and canonical",
    "I8": "garbage changes nothing",
    "I9": "restarts resume from the journal",
    "I10": "no acknowledged job is lost",
    CRASH: "nothing breaks",
}


def render_campaign(
    totals: Mapping[str, Any], reports: Iterable[Mapping[str, Any]], failed: int
) -> Printable:
    """Return the totals that `mrbt sim chaos --json` prints, and reports of some `failed` seeds."""
    results = ", ".join(f"{number} {name}" for name, number in sorted(totals["results"].items()))
    rate = totals["seeds"] / max(0.001, totals["took_s"])
    line = f"{totals['seeds']} seeds in {totals['took_s']:.1f} s, {rate:.1f} a second: {results}"
    mark = ("✔ no invariant broken", "bold green")
    if failed:
        mark = (f"✘ {failed} failed", "bold red")
    twice = (
        f"done more often than their max, in partitions and after crashes: {totals['done_twice']} "
        f"local tasks, {totals['exclusive_done_twice']} of exclusive ones"
    )
    checks = table("", "", "checks", "in seeds", right=(2, 3))
    for name, checked in totals["checks"].items():
        seeds = totals["seeds_checked"][name]
        checks.add_row(name, INVARIANTS.get(name, ""), f"{checked:,}", f"{seeds:,}")
    return Stack(
        Styled.assemble(mark, f"  {line}"),
        checks,
        Styled(twice, "dim"),
        *(line for report in reports for line in _failure(report)),
    )


def _failure(report: Mapping[str, Any]) -> Iterator[Styled]:
    """Yield the broken invariants, the faults needed, and how to reproduce the failure."""
    yield Styled(f"\nseed {report['seed']}", "bold red")
    for violation in report["violations"][:3]:
        name = violation.partition(" ")[0]
        yield Styled.assemble(f"  {violation} ", (f"({INVARIANTS.get(name, name)})", "dim"))
    if "minimised" in report:
        word = "" if report["is_minimal"] else ", time was up"
        text = f"of {report['of']} faults these {len(report['minimised'])} are enough"
        yield Styled.assemble("  ", (text, "bold"), f" ({report['runs']} runs{word}):")
        for at_s, fault in report["minimised"]:
            yield Styled(f"  {at_s:12.6f} s  {fault}")
    yield Styled(f"  replay: {report['replay']}")
    yield Styled(f"  command: {report['command']}")
