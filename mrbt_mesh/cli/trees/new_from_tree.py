"""A mission and a robot of one's own out of a BehaviorTree.CPP file, as `mrbt new --btcpp` writes.

The tree is lifted in units for three robots, and each of its leaves is a function that takes time
and succeeds: what is to be filled in.
"""

from __future__ import annotations

import keyword
import re
import tempfile
from pathlib import Path

from mrbt_mesh.analysis.lift_units import check_subtrees
from mrbt_mesh.cli.trees.lifting import LiftRequest, library_and_tree, lift_files
from mrbt_mesh.errors import InputError
from mrbt_mesh.formats.btcpp.document import LEAVES, Category, Direction, NodeManifest, pointer
from mrbt_mesh.formats.btcpp.expand import ExpandedNode, expand
from mrbt_mesh.formats.btcpp.export import explicit
from mrbt_mesh.formats.btcpp.library import Library
from mrbt_mesh.formats.btcpp.loadable import loadable
from mrbt_mesh.local.builder import NODE_TYPES

_TYPES = {
    "int": "int",
    "unsigned": "int",
    "unsigned int": "int",
    "int64_t": "int",
    "double": "float",
    "float": "float",
    "bool": "bool",
    "std::string": "str",
}
_VALUES = {"int": "1", "float": "1.0", "bool": "True"}
_TEXT = '"..."'

TEAM = """\
# The team that {tree} is for. Lift it again after a change:
#
#     mrbt lift {tree} --robots team.yaml --units auto -o mission.yaml
#
# What `local_tasks`, `conditions` and `capabilities` may say is in docs/lift.md.

program: robot.py
local_tasks: {{}}
robot_types: {{robot: {{capabilities: {{}}}}}}
robots: {{R1: robot, R2: robot, R3: robot}}
"""
TEST = '''\
"""What the team must do, in virtual time and with faults. Run it with `pytest`."""

from mrbt_mesh.testing import Kill, RunMission


def test_whoever_dies_is_replaced(run_mission: RunMission) -> None:
    usual = run_mission("mission.yaml")
    run = run_mission("mission.yaml", faults=[(1, Kill("R1"))])
    assert run.result == usual.result
'''
# Longer lines of a program are broken.
WIDTH = 100
_HEAD = '''\
"""What a robot does for the leaves of {tree}: one function for each of them."""

import anyio

from mrbt_mesh import RobotProgram
{imports}
robot = RobotProgram(record_work=True)  # starts and ends stand in the run's events.jsonl
'''
_WORK = "    await anyio.sleep(1)  # in place of the robot's work; to fail, raise TaskFailedError"
# In a ReactiveSequence two actions that take their time, one after the other, never end.
_AT_ONCE = """\
    # What follows it is asked only after this, at every tick. If that takes its time (`async`),
    # this has to end at once. To fail, raise TaskFailedError."""
_DECORATOR = '''\
@robot.node("{name}")
class {called}(TreeNode):
    """In place of the decorator's own rule: what its child returns.{ports}"""

    CHILDREN = (1, 1)

    def tick(self) -> NodeStatus:
{writes}        status = self.children[0].execute()
        return status if status is NodeStatus.RUNNING else self.ended(status)
'''
_CONTROL = '''\
@robot.node("{name}")
class {called}(TreeNode):
    """In place of the control's own rule: its children in turn, while they succeed.{ports}"""

    CHILDREN = (1, None)

    def tick(self) -> NodeStatus:
{writes}        for child in self.children:
            status = child.execute()
            if status is NodeStatus.RUNNING:
                return status
            if status is NodeStatus.FAILURE:
                return self.ended(status)
        return self.ended(NodeStatus.SUCCESS)
'''


def files_from_tree(file: Path, tree_id: str | None, others: Library) -> dict[str, str]:
    """The texts by file name, of this tree or the main one; `others` has SubTrees and models.

    Raises InputError, TreeFileError and MissionError.
    """
    library, main = library_and_tree(file, tree_id, others)
    library.take_in(main)
    check_subtrees(expand(library, main))
    if library.missing_files:
        missing = ", ".join(library.missing_files)
        raise InputError(f"{file}: what it includes cannot be read: {missing}")
    tree = f"{re.sub(r'[^A-Za-z0-9_-]', '_', file.stem)}.xml"
    document = loadable(explicit(library, is_merged=True))
    document.root.attributes["main_tree_to_execute"] = main
    files = {
        tree: document.text(),
        "team.yaml": TEAM.format(tree=tree),
        "robot.py": program_text(library, main, tree),
        "test_mission.py": TEST,
    }
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for path, text in files.items():
            (folder / path).write_text(text, encoding="utf-8")
        mission = folder / "mission.yaml"
        request = LiftRequest(
            folder / tree, folder / "team.yaml", mission, main, (), (), (), "auto"
        )
        lifted = {path.name: text for path, text in lift_files(request).files.items()}
    return {**lifted, **files}


def program_text(library: Library, tree: str, file: str) -> str:
    """A robot's program: a function for each leaf of a tree, a class for other nodes of its own."""
    uses: dict[str, list[ExpandedNode]] = {}
    at_once: set[str] = set()
    for node in expand(library, tree).root.walk():
        if node.type not in NODE_TYPES and node.category is not Category.SUBTREE:
            uses.setdefault(node.type, []).append(node)
        guards = {"ReactiveSequence": node.children[:-1], "WhileDoElse": node.children[:1]}
        for guard in guards.get(node.type, ()):
            at_once |= {below.type for below in guard.walk()}
    body = "\n\n".join(
        _function(name, nodes, library, name in at_once)
        if nodes[0].category in LEAVES
        else _class(name, nodes, library)
        for name, nodes in uses.items()
    )
    names = ("InOut", "NodeStatus", "Out", "TreeNode")
    used = [name for name in names if re.search(rf"\b{name}\b", body)]
    imports = f"from mrbt_mesh.local import {', '.join(used)}\n" if used else ""
    return f"{_HEAD.format(tree=file, imports=imports)}\n\n{body}"


def _class(name: str, uses: list[ExpandedNode], library: Library) -> str:
    ports = _ports(uses, library.model(name))
    inputs = ", ".join(
        f'self.input("{port}")'
        for port, (direction, _, _) in ports.items()
        if direction is not Direction.OUTPUT
    )
    told = f"\n\n    It may read {inputs}.\n    " if inputs else ""
    writes = ""
    for port, (direction, kind, may_miss) in ports.items():
        if direction is Direction.OUTPUT:
            write = f'self.output("{port}", {_VALUES.get(kind, _TEXT)})\n'
            given = f'        if "{port}" in self.ports:\n            ' if may_miss else " " * 8
            writes += given + write
    called = re.sub(r"\W+", "_", name)
    called = called if called.isidentifier() and not keyword.iskeyword(called) else f"Node_{called}"
    template = _CONTROL if uses[0].category is Category.CONTROL else _DECORATOR
    return template.format(name=name, called=called, ports=told, writes=writes)


def _function(name: str, uses: list[ExpandedNode], library: Library, is_at_once: bool) -> str:
    model = library.model(name)
    ports = _ports(uses, model)
    called = re.sub(r"\W+", "_", re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name)).lower()
    called = f"do_{called}" if keyword.iskeyword(called) or not called.isidentifier() else called
    is_plain = all(port.isidentifier() and not keyword.iskeyword(port) for port in ports)
    parameters = [_parameter(port, *ports[port]) for port in ports]
    if not is_plain:
        parameters = ["**ports: object"]
    writes = _writes(ports) if is_plain else []
    if uses[0].category is Category.CONDITION:
        signature = _signature(f"def {called}", parameters, "bool")
        answer = "    return True  # in place of a look at the world"
        return "\n".join([f'@robot.condition("{name}")', signature, *writes, answer]) + "\n"
    lines = [f'@robot.action("{name}")']
    if is_at_once:
        lines += [_signature(f"def {called}", parameters, "None"), _AT_ONCE]
    else:
        lines += [_signature(f"async def {called}", parameters, "None"), _WORK]
    if is_at_once and all(line.lstrip().startswith("#") for line in writes):
        writes.append("    return")
    return "\n".join(lines + writes) + "\n"


def _writes(ports: dict[str, tuple[Direction, str, bool]]) -> list[str]:
    lines = []
    for port, (direction, kind, may_miss) in ports.items():
        if direction is Direction.OUTPUT:
            lines += [f"    if {port} is not None:"] if may_miss else []
            indent = "        " if may_miss else "    "
            lines.append(f"{indent}{port}.set({_VALUES.get(kind, _TEXT)})")
        elif direction is Direction.INOUT:
            lines.append(f"    # {port}.set(...), if it writes that port")
    return lines


def _signature(head: str, parameters: list[str], result: str) -> str:
    text = f"{head}({', '.join(parameters)}) -> {result}:"
    if len(text) <= WIDTH:
        return text
    return "\n".join([f"{head}(", *(f"    {each}," for each in parameters), f") -> {result}:"])


def _ports(
    uses: list[ExpandedNode], model: NodeManifest | None
) -> dict[str, tuple[Direction, str, bool]]:
    """Each port with its direction, its type in Python, and whether it may be missing.

    Without a model, one that only ever points to entries may be written. What the model has and
    no node is given is left out.
    """
    found: dict[str, tuple[Direction, str, bool]] = {}
    for port in model.ports.values() if model else ():
        if port.default is None and not any(port.name in use.ports for use in uses):
            continue
        # Editors write an output that is left out as an empty text.
        is_written = port.direction is not Direction.INPUT
        given = [
            port.name in use.ports and not (is_written and not use.ports[port.name]) for use in uses
        ]
        missing = not all(given) and port.default is None
        found[port.name] = (port.direction, _TYPES.get(port.type, ""), missing)
    for name in (name for use in uses for name in use.ports):
        missing = any(name not in use.ports for use in uses)
        texts = [use.element.get(name) for use in uses if name in use.ports]
        is_entry = all(pointer(text, name) is not None for text in texts)
        direction = Direction.INOUT if is_entry else Direction.INPUT
        found.setdefault(name, (direction, "", missing))
    return dict(sorted(found.items(), key=lambda item: item[1][2]))


def _parameter(name: str, direction: Direction, kind: str, may_miss: bool) -> str:
    shape = {Direction.OUTPUT: "Out", Direction.INOUT: "InOut"}.get(direction, "")
    inner = kind or "object"
    annotation = f"{shape}[{inner}]" if shape else inner
    return f"{name}: {annotation}" + (" | None = None" if may_miss else "")
