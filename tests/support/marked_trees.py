"""Random trees of one robot, with marks for a team, and what became of them: alone, and lifted."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import anyio
import anyio.lowlevel

from mrbt_mesh import RobotProgram, TaskFailedError
from mrbt_mesh.analysis.lift.folder import Lifted, TreeFiles, lift_files
from mrbt_mesh.analysis.lift.marks import WantedMarks
from mrbt_mesh.btcpp import BehaviorTree, InOut, Leaves, Out, TickError
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.formats.shipped import write_files
from mrbt_mesh.sim import Schedule, SimulationResult, simulate

MODELS = """<TreeNodesModel>
<Action ID="Do"><input_port name="n"/></Action>
<Action ID="Put"><input_port name="n"/><output_port name="out"/></Action>
<Action ID="Take"><input_port name="n"/><input_port name="value"/></Action>
<Action ID="Change"><input_port name="n"/><inout_port name="both"/></Action>
<Condition ID="Ask"><input_port name="n"/></Condition>
</TreeNodesModel>"""
INNER = {
    "Pair": '<Sequence><Put n="{n}" out="{x}"/><Take n="{n}" value="{x}"/></Sequence>',
    "Apart": '<Sequence><Do n="{n}"/><Take n="{n}" value="{x}"/></Sequence>',
    "Again": (
        '<Repeat num_cycles="2"><Fallback><Do n="{n}"/><SubTree ID="Pair" n="{n}"/></Fallback>'
        "</Repeat>"
    ),
}
KEYS = ("k0", "k1", "k2")
DECORATORS = {
    "Inverter": "",
    "ForceSuccess": "",
    "ForceFailure": "",
    "RetryUntilSuccessful": ' num_attempts="3"',
    "Repeat": ' num_cycles="2"',
    "RunOnce": "",
}


@dataclass
class MarkedGrower:
    """Grows the XML of a tree; every leaf has a number of its own. `marks` are how many nodes of
    ten have one; `parallel`: also such.
    """

    random: random.Random
    marks: int = 0
    parallel: bool = False
    leaves: int = 0

    def document(self) -> str:
        inner = "".join(f'<BehaviorTree ID="{n}">{b}</BehaviorTree>' for n, b in INNER.items())
        first = "<Script code='k0 := 1; k1 := 2; k2 := 3'/>" if not self.marks else ""
        body = f"<Sequence>{first}{self.some(3, 2, 4)}</Sequence>"
        main = f'<BehaviorTree ID="Main">{body}</BehaviorTree>'
        return f'<root BTCPP_format="4" main_tree_to_execute="Main">{main}{inner}{MODELS}</root>'

    def tree(self, depth: int) -> str:
        if depth == 0 or self.random.random() < 0.15:
            return self.leaf()
        kind = self.random.choice(
            ["Sequence"] * 6
            + ["Fallback"] * 3
            + ["Decorator"] * 3
            + ["Reactive", "IfThenElse", "SequenceWithMemory"]
        )
        if kind == "Decorator":
            name = self.random.choice(list(DECORATORS))
            return f"<{name}{DECORATORS[name]}{self.mark()}>{self.tree(depth - 1)}</{name}>"
        if kind == "IfThenElse":
            asked = self.random.choice([self.condition(), self.tree(depth - 1)])
            return f"<IfThenElse>{asked}{self.some(depth, 2, 2)}</IfThenElse>"
        if kind == "Reactive":
            name = self.random.choice(["ReactiveSequence", "ReactiveFallback"])
            return f"<{name}>{self.condition()}{self.tree(depth - 1)}</{name}>"
        extra = self.mark()
        if kind != "SequenceWithMemory" and self.parallel and self.random.random() < 0.3:
            extra = ' _parallel="true"'
        if not extra and self.random.random() < 0.05:
            extra = ' _skipIf="1 == 1"'
        return f"<{kind}{extra}>{self.some(depth, 2, 4)}</{kind}>"

    def mark(self) -> str:
        return ' _team="true"' if self.random.random() * 10 < self.marks else ""

    def some(self, depth: int, least: int, most: int) -> str:
        count = self.random.randint(least, most)
        return "".join(self.tree(depth - 1) for _ in range(count))

    def number(self) -> int:
        self.leaves += 1
        return self.leaves

    def condition(self) -> str:
        return f'<Ask n="{self.number()}"/>'

    def leaf(self) -> str:
        number, key = self.number(), self.random.choice(KEYS)
        with_entries = ["Put", "Take", "Change", "Script", "ScriptCondition"]
        some = ["Do"] * 8 + ["Ask", "AlwaysSuccess", "AlwaysFailure", *INNER, *INNER]
        kind = self.random.choice(some + (with_entries if not self.marks else ["Put"]))
        match kind:
            case "Script":
                return f'<Script code="{key} := {number}; {self.random.choice(KEYS)} += 1"/>'
            case "ScriptCondition":
                return f'<ScriptCondition code="{key} &gt; {number // 2}"/>'
            case "AlwaysSuccess" | "AlwaysFailure":
                return f"<{kind}/>"
            case "Pair" | "Again":
                return f'<SubTree ID="{kind}" n="{number}"{self.mark()}/>'
            case "Apart":
                given = self.random.choice(["dock", "some text; any"])
                return f'<SubTree ID="Apart" n="{number}" x="{given}"{self.mark()}/>'
        port = {"Put": "out", "Take": "value", "Change": "both"}.get(kind)
        text = f' {port}="{{{key}}}"' if port else ""
        mark = self.mark() if kind != "Ask" else ""
        return f'<{kind} n="{number}"{text}{mark}/>'


@dataclass
class Story:
    """How leaves end, by their numbers; `by_turn`: a leaf may end otherwise the next time."""

    seed: int
    by_turn: bool = True
    log: list[tuple[str, str, Any]] = field(default_factory=list)

    def succeeds(self, leaf: str, number: str, turn: int = 0) -> bool:
        text = f"{self.seed}/{leaf}/{number}/{turn if self.by_turn else 0}"
        return random.Random(text).random() < 0.75

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


def alone(text: str, story: Story) -> str:
    """The result of the single robot's tree: success, failure, or error for one that broke."""
    tree = BehaviorTree.from_text(text)
    register(tree.leaves, story, anyio.lowlevel.checkpoint)
    try:
        status = anyio.run(tree.run).name
    except TickError:  # such as IfThenElse with a condition that is skipped
        return "error"
    return "failure" if status == "FAILURE" else "success"


def lifted(text: str, folder: Path, robots: int = 3, **marks: Any) -> Lifted:
    """The tree's mission, in `folder`."""
    (folder / "tree.xml").write_text(text)
    found = lift_files(TreeFiles(folder / "tree.xml"), WantedMarks(**marks), robots, folder / "new")
    write_files(folder / "new", dict(found.files))
    return found


def run_lifted(
    folder: Path, story: Story, schedule: Schedule = (), seed: int = 1
) -> SimulationResult:
    """A run of the mission in `folder`, whose robots do as the story says."""
    program = RobotProgram()
    register(program, story, lambda: anyio.sleep(0.5))
    mission = load_mission(folder / "new" / "mission.yaml")
    result = simulate(mission, program, seed=seed, schedule=schedule, timeout_us=600_000_000)
    assert result.violations == []
    return result
