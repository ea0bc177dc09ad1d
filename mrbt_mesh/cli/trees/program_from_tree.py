"""A robot's program for a BehaviorTree.CPP tree, to be filled in: `mrbt new --btcpp`."""

from __future__ import annotations

import keyword
import re
from dataclasses import dataclass, field

from mrbt_mesh.formats.btcpp.builtin_nodes import BUILTIN
from mrbt_mesh.formats.btcpp.document import LEAVES, Category, Direction, NodeManifest, pointer
from mrbt_mesh.formats.btcpp.entries import access_below, port_direction, read_scripts
from mrbt_mesh.formats.btcpp.expand import SCRIPT_PORTS, ExpandedNode, expand
from mrbt_mesh.formats.btcpp.library import Library
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

# A name that a script compares with a text.
_COMPARED = r"(?<!\w){0}\s*[=!]=\s*'([^'\"\\]*)'|'([^'\"\\]*)'\s*[=!]=\s*{0}(?!\w)"
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
_SOURCES = {
    "robot_pose": """\
@robot.source("robot_pose")
def robot_pose() -> tuple[float, float]:
    return 0.0, 0.0  # metres; in place of the robot's odometry
""",
    "robot_speed": """\
@robot.source("robot_speed")
def robot_speed() -> float:
    return 0.5  # metres a second; in place of the robot's odometry
""",
}
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


@dataclass
class _Needs:
    """What a tree needs of a program. `uses`: its own nodes, by type.

    `at_once`: types of nodes that are done at every tick. `in_scripts`: a value for each entry that
    scripts read, with which they can be run. `entries`: what the tree only reads, with the type in
    Python, if that is known. `enums`: names in scripts that look like an enum's. `sources`: what
    Nav2's nodes ask for.
    """

    uses: dict[str, list[ExpandedNode]] = field(default_factory=dict)
    at_once: set[str] = field(default_factory=set)
    in_scripts: dict[str, str] = field(default_factory=dict)
    entries: dict[str, str] = field(default_factory=dict)
    enums: list[str] = field(default_factory=list)
    sources: list[str] = field(default_factory=list)


def _needs(library: Library, root: ExpandedNode) -> _Needs:
    needs = _Needs()
    reads: dict[str, str] = {}
    for node in root.walk():
        if node.type not in NODE_TYPES and node.category is not Category.SUBTREE:
            needs.uses.setdefault(node.type, []).append(node)
        guards = {"ReactiveSequence": node.children[:-1], "WhileDoElse": node.children[:1]}
        for guard in guards.get(node.type, ()):
            needs.at_once |= {below.type for below in guard.walk()}
        if node.type in NODE_TYPES:
            needs.sources += NODE_TYPES[node.type].SOURCES
        model = library.model(node.type) or BUILTIN.get(node.type)
        for name, text in node.ports.items():
            port, key = model.ports.get(name) if model else None, pointer(text, name)
            if key is not None and port_direction(node, name, library) is Direction.INPUT:
                reads[key] = reads.get(key) or _TYPES.get(port.type if port else "", "")
        texts = [node.ports.get(SCRIPT_PORTS.get(node.type, ""), ""), *node.conditions.values()]
        for text in filter(None, texts):
            for name in (name for script in read_scripts([text]) for name in script.read):
                compared = re.search(_COMPARED.format(re.escape(name)), text)
                value = f'"{compared[1] or compared[2]}"' if compared else "1"
                needs.in_scripts[name] = max(value, needs.in_scripts.get(name, value))
    written = access_below([root], library).writes
    found = {name for name in {*reads, *needs.in_scripts} - written if name.isidentifier()}
    # A script's name in a SubTree is that of an entry of the SubTree's, unless it is an enum's.
    bare = {name: re.sub(r"^\w*_\d+__", "", name) for name in found}
    enums = {n for n in found if n not in reads and re.fullmatch(r"[A-Z][A-Z0-9_]*", bare[n])}
    needs.enums = sorted({bare[name] for name in enums})
    needs.entries = {n: reads.get(n, "") for n in sorted(found - enums) if bare[n] == n}
    needs.sources = sorted(set(needs.sources))
    return needs


def program_text(library: Library, tree: str, file: str) -> str:
    """A robot's program: a function for each leaf of a tree, a class for other nodes of its own.

    And what the tree asks the program for: entries that it only reads, enums, Nav2's sources.
    """
    needs = _needs(library, expand(library, tree).root)
    parts = [f'robot.enum("{name}", {number})\n' for number, name in enumerate(needs.enums)]
    parts = ["".join(parts)] if parts else []
    parts += [_entry(name, kind, needs) for name, kind in needs.entries.items()]
    parts += [_SOURCES[name] for name in needs.sources]
    parts += [
        _function(name, nodes, library, needs)
        if nodes[0].category in LEAVES
        else _class(name, nodes, library)
        for name, nodes in needs.uses.items()
    ]
    body = "\n\n".join(parts)
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


def _entry(name: str, kind: str, needs: _Needs) -> str:
    value = _VALUES.get(kind) or needs.in_scripts.get(name, _TEXT)
    called = f"{name.lower()}_" if keyword.iskeyword(name.lower()) else name.lower()
    return (
        f'@robot.entry("{name}")\ndef {called}() -> {kind or "object"}:\n'
        f"    return {value}  # asked before each tick; nothing in the tree writes it\n"
    )


def _function(name: str, uses: list[ExpandedNode], library: Library, needs: _Needs) -> str:
    is_at_once = name in needs.at_once
    ports = _ports(uses, library.model(name))
    called = re.sub(r"\W+", "_", re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name)).lower()
    called = f"do_{called}" if keyword.iskeyword(called) or not called.isidentifier() else called
    is_plain = all(port.isidentifier() and not keyword.iskeyword(port) for port in ports)
    parameters = [_parameter(port, *ports[port]) for port in ports]
    if not is_plain:
        parameters = ["**ports: object"]
    keys = {(port, pointer(use.ports[port], port) or "") for use in uses for port in use.ports}
    asked = {port: needs.in_scripts[key] for port, key in sorted(keys) if key in needs.in_scripts}
    writes = _writes(ports, asked) if is_plain else []
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


def _writes(ports: dict[str, tuple[Direction, str, bool]], asked: dict[str, str]) -> list[str]:
    """The lines that write ports. `asked`: values for those whose entries scripts read."""
    lines = []
    for port, (direction, kind, may_miss) in ports.items():
        if direction is Direction.OUTPUT or (direction is Direction.INOUT and port in asked):
            lines += [f"    if {port} is not None:"] if may_miss else []
            indent = "        " if may_miss else "    "
            lines.append(f"{indent}{port}.set({_VALUES.get(kind) or asked.get(port, _TEXT)})")
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
        direction, texts = port.direction, [use.ports.get(port.name, "") for use in uses]
        if direction is Direction.INOUT and any(t and pointer(t, port.name) is None for t in texts):
            # A node that is given a constant there has nothing to write to.
            direction = Direction.INPUT
        found[port.name] = (direction, _TYPES.get(port.type, ""), missing)
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
