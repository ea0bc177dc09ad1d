"""docs/data/paper.md and its pictures, put together from the mission and the run's record."""

from __future__ import annotations

import textwrap
from pathlib import Path

from mrbt_mesh.core.mission.mission import Mission
from paper.account import SEED, Account, AccountError, tell
from paper.caption import all_of, caption, seconds
from paper.picture import draw
from paper.situations import SITUATIONS, Situation, find
from paper.standing import damages
from paper.tables import bounds, performances, table, tree_lines
from paper.tolerance import spares, survived

DOCUMENT = Path("docs") / "data" / "paper.md"
PICTURES = DOCUMENT.with_suffix("")
COMMAND = "`mrbt sim run examples/vehicle_repair/standing_by.yaml --timeout 90`"


def files(seed: int = SEED) -> dict[Path, str]:
    """Every file with its text, relative to the project.

    Raises AccountError if the run does not go as the paper tells.
    """
    account = tell(seed)
    if account.result.result != "success":
        raise AccountError(f"seed {seed}: the mission ends in {account.result.result}")
    found: dict[Path, str] = {}
    shown: list[str] = []
    for number, (situation, scene) in enumerate(zip(SITUATIONS, find(account), strict=True), 1):
        picture = PICTURES / f"situation-{number}.svg"
        title = f"Situation {situation.number}: {situation.title}"
        lines = caption(scene, account.record)
        found[picture] = draw(scene, title, lines)
        shown += _situation(situation, title, lines, picture.relative_to(DOCUMENT.parent))
    sections = (
        _introduction(account),
        _team(account.mission),
        _tree(account.mission),
        _execution(account, shown),
        _standing_by(seed),
        _tolerance(account.mission),
    )
    found[DOCUMENT] = "\n".join(line for section in sections for line in section)
    return found


def _paragraph(text: str) -> list[str]:
    wrapped = textwrap.wrap(text, 98, break_long_words=False, break_on_hyphens=False)
    return [*wrapped, ""]


def _introduction(account: Account) -> list[str]:
    return [
        "# The paper's example, run again",
        "",
        *_paragraph(
            "Section VI of *Adaptive Fault Tolerant Execution of Multi-Robot Missions using "
            "Behavior Trees* (Colledanchise, Marzinotto, Dimarogonas, Ögren): six robots repair "
            "the electronics of a vehicle. `python -m paper` writes this page and its pictures; "
            "nothing in them is drawn by hand. The tables, the tree and the figures on faults come "
            "from the mission file, `examples/vehicle_repair/mission.yaml`, the situations from "
            f"the record of one run in virtual time (seed {account.seed})."
        ),
    ]


def _team(mission: Mission) -> list[str]:
    types = list(mission.robot_types)
    members = {t: [r.id for r in mission.robots.values() if r.type == t] for t in types}
    team = ", ".join(f"{all_of(robots)} of type {kind}" for kind, robots in members.items())
    parts, broken = mission.parameters["parts"], mission.parameters["broken_parts"]
    return [
        "## Team and tasks",
        "",
        *_paragraph(
            f"The team: {team}. The vehicle has {len(parts)} parts, of which "
            f"{all_of([str(part) for part in broken])} are broken; only diagnosis shows it."
        ),
        "How well robots do their local tasks, p(i, l); higher is better, and faster:",
        "",
        *table(["local task", *(f"robots {kind}" for kind in types)], performances(mission)),
        "",
        *_paragraph(
            "What the global tasks ask for: of each local task l in ψ(g), at least ν(g, l) and "
            "at most μ(g, l) robots:"
        ),
        *table(["global task g", "local task l", "ν", "μ"], bounds(mission)),
        "",
    ]


def _tree(mission: Mission) -> list[str]:
    return [
        "## The tree",
        "",
        "T_G, the same on every robot; `?` marks conditions:",
        "",
        *(f"    {line}" for line in tree_lines(mission)),
        "",
    ]


def _execution(account: Account, shown: list[str]) -> list[str]:
    (fault,) = account.record.major
    assert fault.held is not None
    return [
        "## Execution",
        "",
        *_paragraph(
            f"One run holds all eight situations. {fault.robot} is killed at "
            f"{seconds(account.record, fault.at_us)}, when it has just put in its hardware and "
            f"claimed `{fault.held.local_task}`; {fault.replacement} is the first that starts it "
            f"instead. The mission succeeds after {account.result.summary['duration_s']:.2f} s."
        ),
        *_paragraph(
            "Each picture shows the first moment in the run's record at which its situation "
            "holds, and below it what the record says. Parts are grey while they have not been "
            "diagnosed, green if they are in order or repaired, red if broken. Times count from "
            "the first robot's joining."
        ),
        *shown,
    ]


def _situation(situation: Situation, title: str, lines: list[str], picture: Path) -> list[str]:
    return [
        f"### {title}",
        "",
        *_paragraph(situation.text),
        f"![{' '.join(lines)}]({picture.as_posix()})",
        "",
    ]


def _standing_by(seed: int) -> list[str]:
    found = damages(seed)
    rows = [
        (
            number,
            all_of(list(each.parts)),
            f"{each.at_s:.2f} s",
            f"{each.took_s:.2f} s",
            all_of(list(each.robots)),
        )
        for number, each in enumerate(found, start=1)
    ]
    return [
        "## From one damage to the next",
        "",
        *_paragraph(
            "In the paper the team does not go home: under normal conditions nobody is assigned, "
            "a_j = b_j = 0; a fault on the vehicle takes place, the condition *Normal Operating "
            "Conditions* is no longer true on any robot, and *Remove Screws* has to be executed. "
            "A second mission file, `examples/vehicle_repair/standing_by.yaml`, says `ends: "
            "never`, and "
            f"{len(found)} damages come in. The robot that puts in the last screw reports that all "
            "is well, T_G succeeds, and the team stands by. Nothing has to be reset: the condition "
            "that turned has renewed all nodes behind it."
        ),
        *table(["round", "broken parts", "from", "took", "robots"], rows),
        "",
        *_paragraph(f"So it went in virtual time, seed {seed}: {COMMAND}."),
    ]


def _tolerance(mission: Mission) -> list[str]:
    counted = spares(mission)
    found = survived(mission)
    minor, major = found.minor, len(found.majors[0])
    fatal = {fault[1] for fault in found.critical if not isinstance(fault, str)}
    (frame,) = (spare for spare in counted if spare.local_task in fatal)
    (solder,) = (spare for spare in counted if spare.local_task == "use_soldering_iron")
    rows = [
        (spare.local_task, " ".join(spare.capable), len(spare.capable), spare.needed, spare.count)
        for spare in counted
    ]
    sets = ", or ".join(all_of(list(dead)) for dead in found.majors)
    return [
        "## Faults it survives",
        "",
        *_paragraph(
            "A minor fault takes one capability from one robot, a major one takes all of a "
            "robot's. Each global task here needs one local task, and if need be they are done "
            "one after the other: so a local task may become as rare as the largest ν that asks "
            "for it."
        ),
        *table(["local task", "capable", "robots", "needed", "to spare"], rows),
        "",
        *_paragraph(
            f"**Up to {minor} minor faults**: the sum of the last column. The paper names the same "
            f"total, but the faults that it lists add up to {minor - solder.count}: it leaves out "
            f"`{solder.local_task}`, which {all_of(list(solder.capable))} can do while one of "
            "them is enough."
        ),
        *_paragraph(
            f"**Up to {major} major faults**: {sets}, found by trying all sets of robots. One B "
            "is needed, since nobody else solders, and it can do all that an A can."
        ),
        *_paragraph(
            f"**Neither weakly nor strongly fault tolerant**: `{frame.local_task}` needs "
            f"{frame.needed} robots, and only {all_of(list(frame.capable))} can do it. To lose "
            "either, or this capability of either, is fatal."
        ),
    ]
