"""Random trees of one robot that share a blackboard, and what became of them: alone, in units."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import anyio
import anyio.lowlevel

from mrbt_mesh import RobotProgram, TaskFailedError
from mrbt_mesh.analysis.lift.in_units import LiftedUnits, lift_units
from mrbt_mesh.btcpp import BehaviorTree, InOut, Leaves, Out, TickError
from mrbt_mesh.btcpp.files.check import check_library
from mrbt_mesh.btcpp.files.document import parse_document
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.files.library import Library, library_of
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.formats.mission_writer import mission_text
from mrbt_mesh.formats.team_file import TeamFile, load_team

KEYS = ("k0", "k1", "k2", "k3", "k4", "k5")
MODELS = """<TreeNodesModel>
<Action ID="Do"><input_port name="n"/></Action>
<Action ID="Put"><input_port name="n"/><output_port name="out"/></Action>
<Action ID="Take"><input_port name="n"/><input_port name="value"/></Action>
<Action ID="Change"><input_port name="n"/><inout_port name="both"/></Action>
<Condition ID="Ask"><input_port name="n"/></Condition>
<Condition ID="Known"><input_port name="n"/></Condition>
<Condition ID="Off"/>
</TreeNodesModel>"""
INNER = {
    "Pair": ('<Sequence><Put n="{n}" out="{x}"/><Take n="{n}" value="{x}"/></Sequence>'),
    "Apart": ('<Sequence><Do n="{n}"/><Take n="{n}" value="{x}"/></Sequence>'),
    "Auto": ('<Fallback><Do n="{n}"/><Change n="{n}" both="{k0}"/></Fallback>'),
}


@dataclass
class UnitGrower:
    """Grows the XML of a tree; every leaf has a number of its own."""

    random: random.Random
    with_parallel: bool = False
    leaves: int = 0

    def document(self) -> str:
        inner = "".join(f'<BehaviorTree ID="{n}">{b}</BehaviorTree>' for n, b in INNER.items())
        main = f'<BehaviorTree ID="Main">{self.tree(3)}</BehaviorTree>'
        return f'<root BTCPP_format="4" main_tree_to_execute="Main">{main}{inner}{MODELS}</root>'

    def tree(self, depth: int) -> str:
        if depth == 0 or self.random.random() < 0.15:
            return self.leaf()
        kind = self.random.choice(
            ["Sequence"] * 6
            + ["Fallback"] * 3
            + ["Decorator"] * 3
            + ["Reactive", "IfThenElse", "SequenceWithMemory", "Parallel"]
        )
        if kind == "Decorator":
            return self.decorator(depth)
        if kind == "Parallel" and not self.with_parallel:
            kind = "Sequence"
        if kind == "IfThenElse":
            asked = self.random.choice([self.condition(), self.tree(depth - 1)])
            return f"<IfThenElse>{asked}{self.some(depth, 2, 2)}</IfThenElse>"
        if kind == "Reactive":
            name = self.random.choice(["ReactiveSequence", "ReactiveFallback"])
            return f"<{name}>{self.condition()}{self.tree(depth - 1)}</{name}>"
        if kind in ("SequenceWithMemory",):
            return f"<{kind}>{self.some(depth, 1, 3)}</{kind}>"
        extra = ""
        if self.random.random() < 0.08:
            extra = self.random.choice([' _skipIf="k0 &gt; 4"', ' _onSuccess="k1 := 3"'])
        return f"<{kind}{extra}>{self.some(depth, 2, 4)}</{kind}>"

    def decorator(self, depth: int) -> str:
        name, ports = self.random.choice(
            [
                ("Inverter", ""),
                ("ForceSuccess", ""),
                ("ForceFailure", ""),
                ("RetryUntilSuccessful", ' num_attempts="3"'),
                ("Repeat", ' num_cycles="2"'),
                ("RunOnce", ""),
            ]
        )
        return f"<{name}{ports}>{self.tree(depth - 1)}</{name}>"

    def some(self, depth: int, least: int, most: int) -> str:
        count = self.random.randint(least, most)
        return "".join(self.tree(depth - 1) for _ in range(count))

    def key(self) -> str:
        return self.random.choice(KEYS)

    def number(self) -> int:
        self.leaves += 1
        return self.leaves

    def condition(self) -> str:
        name = self.random.choice(["Ask", "Known", "Off"])
        if name == "Off":
            return "<Off/>"
        return f'<{name} n="{self.number()}"/>'

    def leaf(self) -> str:
        number, key = self.number(), self.key()
        kind = self.random.choice(
            ["Do"] * 8
            + ["Put", "Put", "Take", "Take", "Change", "Script", "ScriptCondition"]
            + [
                "Ask",
                "Known",
                "Off",
                "AlwaysSuccess",
                "AlwaysFailure",
                *INNER,
                *INNER,
                "SetBlackboard",
            ]
        )
        match kind:
            case "Script":
                return f'<Script code="{key} := {number}; {self.key()} += 1"/>'
            case "ScriptCondition":
                return f'<ScriptCondition code="{key} &gt; {number // 2}"/>'
            case "SetBlackboard":
                return f'<SetBlackboard value="{{{self.key()}}}" output_key="{key}"/>'
            case "AlwaysSuccess" | "AlwaysFailure" | "Off":
                return f"<{kind}/>"
            case "Pair" | "Apart":
                given = (
                    f"{{{key}}}"
                    if kind == "Pair" or self.random.random() < 0.6
                    else "some text; any"
                )
                return f'<SubTree ID="{kind}" n="{number}" x="{given}"/>'
            case "Auto":
                return f'<SubTree ID="Auto" n="{number}" _autoremap="true"/>'
        port = {"Put": "out", "Take": "value", "Change": "both"}.get(kind)
        text = f' {port}="{{{key}}}"' if port else ""
        return f'<{kind} n="{number}"{text}/>'


@dataclass
class Story:
    """How leaves end, by their numbers; `by_turn`: a leaf may end otherwise the next time."""

    seed: int
    by_turn: bool = True
    log: list[tuple[str, str, Any]] = field(default_factory=list)

    def succeeds(self, leaf: str, number: str, turn: int = 0) -> bool:
        text = f"{self.seed}/{leaf}/{number}/{turn if self.by_turn else 0}"
        return random.Random(text).random() < 0.65

    def act(self, leaf: str, number: str, value: Any = None) -> None:
        """Note one action; raises if it fails."""
        turn = sum(1 for row in self.log if row[:2] == (leaf, number))
        self.log.append((leaf, number, value))
        if not self.succeeds(leaf, number, turn):
            raise TaskFailedError(f"{leaf} {number} fails")


def register(leaves: Leaves | RobotProgram, story: Story, wait: Callable[[], Any]) -> None:
    """The leaves, which do as the story says."""

    @leaves.action("Do")
    async def do(n: str) -> None:
        await wait()
        story.act("Do", n)

    @leaves.action("Put")
    async def put(n: str, out: Out[Any]) -> None:
        await wait()
        story.act("Put", n)
        out.set(100 + int(n))

    @leaves.action("Take")
    async def take(n: str, value: Any) -> None:
        await wait()
        story.act("Take", n, value)

    @leaves.action("Change")
    async def change(n: str, both: InOut[Any]) -> None:
        await wait()
        story.act("Change", n, both.value)
        both.set(both.value + 1)

    @leaves.condition("Ask")
    def ask(n: str) -> bool:
        return story.succeeds("Ask", n)


def read(text: str) -> Library:
    findings = Findings()
    library = library_of(parse_document(text, "tree.xml"), findings)
    check_library(library, findings)
    findings.raise_errors()
    return library


def alone(text: str, story: Story) -> str:
    """The result of the single robot's tree."""
    tree = BehaviorTree.from_text(text)
    register(tree.leaves, story, anyio.lowlevel.checkpoint)
    # In a team its mission has them.
    tree.condition("Known")(lambda n: True)
    tree.condition("Off")(lambda: False)
    for number, key in enumerate(KEYS):
        tree.blackboard[key] = number
    try:
        return anyio.run(tree.run).name
    except TickError:  # such as IfThenElse with a condition that is skipped
        return "FAILURE"


def team_file(folder: Path, robots: int) -> TeamFile:
    listed = ", ".join(f"R{number + 1}: Robot" for number in range(robots))
    values = ", ".join(f"{key}: {number}" for number, key in enumerate(KEYS))
    # No robot has anything for itself but its blackboard; all change one world, so in order.
    actions = ("Do", "Put", "Take", "Change")
    declared = ", ".join(f"{name}: {{writes: [world], may_fail: true}}" for name in actions)
    able = ", ".join(f"{name}: 1" for name in actions)
    path = folder / "team.yaml"
    path.write_text(
        f"local_tasks: {{{declared}}}\nrobot_types: {{Robot: {{capabilities: {{{able}}}}}}}\n"
        f"parameters: {{{values}}}\n"
        "conditions: {Known: {parameters: [n], default: true}, Off: {}}\n"
        f"robots: {{{listed}}}\n"
    )
    return load_team(path)


def in_units(text: str, folder: Path, robots: int) -> tuple[LiftedUnits, Mission]:
    """The mission of a team that does the tree in units."""
    team = team_file(folder, robots)
    found = lift_units(read(text), "Main", team, (), "units", None, "units.xml")
    (folder / "units.xml").write_text(found.document.text())
    written = mission_text(found.mission.data, "")
    return found, mission_from_yaml(written, "mission.yaml", folder)


def program(story: Story) -> RobotProgram:
    """A robot of that team."""
    robot = RobotProgram()
    register(robot, story, lambda: anyio.sleep(0.5))
    return robot
