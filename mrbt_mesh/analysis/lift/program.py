"""Generates a robot's program, to be filled in, for a BehaviorTree.CPP tree: `mrbt tree lift
--new`.
"""

from __future__ import annotations

import keyword
import re
from dataclasses import dataclass, field

from mrbt_mesh.btcpp.executor.builder import NODE_TYPES
from mrbt_mesh.btcpp.files.builtin_nodes import BUILTIN
from mrbt_mesh.btcpp.files.document import LEAVES, Category, Direction, NodeManifest, pointer
from mrbt_mesh.btcpp.files.entries import access_below, port_direction, read_scripts
from mrbt_mesh.btcpp.files.expand import SCRIPT_PORTS, ExpandedNode, expand
from mrbt_mesh.btcpp.files.library import Library
from mrbt_mesh.btcpp.scripts.values import INTEGERS, ValueTypeError, read_text

_VALUES = {"int": "1", "float": "1.0", "bool": "True", "str": '"..."', "object": '"..."'}
# Names that the program uses itself.
_RESERVED = {"robot", "anyio", "warnings", "warn_not_filled_in", "robot_pose", "robot_speed"}
_RESERVED |= {"RobotProgram", "InOut", "NodeStatus", "Out", "TreeNode", *_VALUES}
# Outputs of Nav2's nodes for errors, with their values for success.
_NO_ERROR = {"error_code_id": "0", "error_msg": '""'}
_NUMBER = "1"

_WORDS = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")
_ANY_TYPE = ("", "AnyTypeAllowed", "BT::AnyTypeAllowed", "BT::Any")

# A name that a script compares with a text.
_COMPARED = r"(?<!\w){0}\s*[=!]=\s*'([^'\"\\]*)'|'([^'\"\\]*)'\s*[=!]=\s*{0}(?!\w)"
# Longer lines of a program are wrapped.
WIDTH = 100
_HEAD = '''\
"""The leaves of {tree}: one function for each of them."""

{warns}import anyio

from mrbt_mesh import RobotProgram
{imports}
robot = RobotProgram(record_work=True)  # starts and ends are in the run's events.jsonl
'''
_WARNS = '''\
def warn_not_filled_in(condition: str) -> None:
    """Take the calls out as you fill in the functions."""
    warnings.warn(f"{condition} is not filled in and answers True", stacklevel=2)
'''
_WORK = "    await anyio.sleep(1)  # in place of the robot's work; to fail, raise TaskFailedError"
# In a ReactiveSequence two actions that take their time, one after the other, never end.
_AT_ONCE = """\
    # The nodes after it are ticked only after this, at every tick. If one of them takes time
    # (`async`), this has to end at once. To fail, raise TaskFailedError."""
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
    """In place of the decorator's own rule: its child's status.{ports}"""

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
    """What a tree needs from its program.

    `uses`: its own nodes, by type. `at_once`: types of nodes that are completed in every tick.
    `in_scripts`: a value for each entry that scripts read, with which they can be run. `entries`:
    those that the tree only reads, with their Python type if it is known. `enums`: names in scripts
    that look like an enum's. `sources`: those of Nav2's nodes. `kinds`: Python types of entries
    according to models and scripts; `object` for those that only scripts write.
    """

    uses: dict[str, list[ExpandedNode]] = field(default_factory=dict)
    at_once: set[str] = field(default_factory=set)
    in_scripts: dict[str, str] = field(default_factory=dict)
    entries: dict[str, str] = field(default_factory=dict)
    enums: list[str] = field(default_factory=list)
    sources: list[str] = field(default_factory=list)
    kinds: dict[str, str] = field(default_factory=dict)
    taken: set[str] = field(default_factory=lambda: set(_RESERVED))

    def called(self, name: str, prefix: str) -> str:
        """Return a name for the program: an identifier that is not taken yet."""
        chosen = re.sub(r"\W+", "_", name)
        if keyword.iskeyword(chosen) or not chosen.isidentifier() or chosen in _RESERVED:
            chosen = f"{prefix}_{chosen}"
        first, number = chosen, 1
        while chosen in self.taken:
            number += 1
            chosen = f"{first}_{number}"
        self.taken.add(chosen)
        return chosen


def _python_type(cpp: str) -> str:
    """Return the Python type of a port.

    Empty if any will do, `str` for types without a counterpart.
    """
    if cpp in _ANY_TYPE:
        return ""
    if cpp in INTEGERS:
        return "int"
    return {"double": "float", "float": "float", "bool": "bool"}.get(cpp, "str")


def _needs(library: Library, root: ExpandedNode) -> _Needs:
    needs = _Needs()
    reads: dict[str, str] = {}
    changed: set[str] = set()
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
            key = pointer(text, name)
            kind = _python_type(model.ports[name].type) if model and name in model.ports else ""
            if key is not None and kind:
                needs.kinds.setdefault(key, kind)
            if key is not None and port_direction(node, name, library) is Direction.INPUT:
                reads[key] = reads.get(key) or kind
        texts = [node.ports.get(SCRIPT_PORTS.get(node.type, ""), ""), *node.conditions.values()]
        for text in filter(None, texts):
            for name in (name for script in read_scripts([text]) for name in script.read):
                compared = re.search(_COMPARED.format(re.escape(name)), text)
                value = f'"{compared[1] or compared[2]}"' if compared else _NUMBER
                needs.in_scripts[name] = max(value, needs.in_scripts.get(name, value))
            changed.update(*(script.written for script in read_scripts([text])))
    for name, value in needs.in_scripts.items():
        needs.kinds.setdefault(name, "float" if value == _NUMBER else "str")
    for name in changed:
        needs.kinds.setdefault(name, "object")
    written = access_below([root], library).writes
    found = {name for name in {*reads, *needs.in_scripts} - written if name.isidentifier()}
    # A name in a SubTree's script is an entry of the SubTree, unless it is an enum's.
    bare = {name: re.sub(r"^\w*_\d+__", "", name) for name in found}
    enums = {n for n in found if n not in reads and re.fullmatch(r"[A-Z][A-Z0-9_]*", bare[n])}
    needs.enums = sorted({bare[name] for name in enums})
    needs.entries = {
        n: reads.get(n) or needs.kinds.get(n, "str") for n in sorted(found - enums) if bare[n] == n
    }
    needs.sources = sorted(set(needs.sources))
    return needs


def program_text(library: Library, tree: str, file: str) -> str:
    """Return a robot's program: a function for each leaf of a tree, a class for its other own
    nodes.

    It also has functions for entries that the tree only reads, enums, and Nav2's sources.
    """
    needs = _needs(library, expand(library, tree).root)
    parts = [f'robot.enum("{name}", {number})\n' for number, name in enumerate(needs.enums)]
    parts = ["".join(parts)] if parts else []
    parts += [_entry(name, kind, needs) for name, kind in needs.entries.items()]
    parts += [_SOURCES[name] for name in needs.sources]
    parts += [
        _function(name, nodes, library, needs)
        if nodes[0].category in LEAVES
        else _class(name, nodes, library, needs)
        for name, nodes in needs.uses.items()
    ]
    if any("warn_not_filled_in" in part for part in parts):
        parts.insert(0, _WARNS)
    body = "\n\n".join(parts)
    names = ("InOut", "NodeStatus", "Out", "TreeNode")
    used = [name for name in names if re.search(rf"\b{name}\b", body)]
    imports = f"from mrbt_mesh.btcpp import {', '.join(used)}\n" if used else ""
    warns = "import warnings\n\n" if _WARNS in parts else ""
    return f"{_HEAD.format(tree=file, warns=warns, imports=imports)}\n\n{body}"


def _class(name: str, uses: list[ExpandedNode], library: Library, needs: _Needs) -> str:
    ports = _ports(uses, library.model(name), needs)
    inputs = ", ".join(
        f'self.input("{port}")'
        for port, (direction, _, _) in ports.items()
        if direction is not Direction.OUTPUT
    )
    reads = f"\n\n    It may read {inputs}.\n    " if inputs else ""
    writes = ""
    for port, (direction, kind, may_miss) in ports.items():
        if direction is Direction.OUTPUT:
            write = f'self.output("{port}", {_value(port, kind)})\n'
            given = f'        if "{port}" in self.ports:\n            ' if may_miss else " " * 8
            writes += given + write
    called = needs.called(name, "Node")
    template = _CONTROL if uses[0].category is Category.CONTROL else _DECORATOR
    return template.format(name=name, called=called, ports=reads, writes=writes)


def _entry(name: str, kind: str, needs: _Needs) -> str:
    value = _value(name, kind, needs.in_scripts.get(name))
    called = needs.called(name.lower(), "entry")
    return (
        f'@robot.entry("{name}")\ndef {called}() -> {kind}:\n'
        f"    return {value}  # asked before each tick; nothing in the tree writes it\n"
    )


def _function(name: str, uses: list[ExpandedNode], library: Library, needs: _Needs) -> str:
    is_at_once = name in needs.at_once
    ports = _ports(uses, library.model(name), needs)
    called = needs.called(_WORDS.sub("_", name).lower(), "do")
    is_plain = all(p.isidentifier() and not keyword.iskeyword(p) and p != "anyio" for p in ports)
    parameters = [_parameter(port, *ports[port]) for port in ports]
    if not is_plain:
        parameters = ["**ports: object"]
    keys = {(port, pointer(use.ports[port], port) or "") for use in uses for port in use.ports}
    asked = {port: needs.in_scripts[key] for port, key in sorted(keys) if key in needs.in_scripts}
    writes = _writes(ports, asked) if is_plain else []
    if uses[0].category is Category.CONDITION:
        signature = _signature(f"def {called}", parameters, "bool")
        answer = [f'    warn_not_filled_in("{name}")', "    return True"]
        return "\n".join([f'@robot.condition("{name}")', signature, *writes, *answer]) + "\n"
    lines = [f'@robot.action("{name}")']
    if is_at_once:
        lines += [_signature(f"def {called}", parameters, "None"), _AT_ONCE]
    else:
        lines += [_signature(f"async def {called}", parameters, "None"), _WORK]
    if is_at_once and all(line.lstrip().startswith("#") for line in writes):
        writes.append("    return")
    return "\n".join(lines + writes) + "\n"


def _writes(ports: dict[str, tuple[Direction, str, bool]], asked: dict[str, str]) -> list[str]:
    """Return the lines that write ports. `asked`: values for those whose entries scripts read."""
    lines = []
    for port, (direction, kind, may_miss) in ports.items():
        if direction is Direction.OUTPUT or (direction is Direction.INOUT and port in asked):
            lines += [f"    if {port} is not None:"] if may_miss else []
            indent = "        " if may_miss else "    "
            lines.append(f"{indent}{port}.set({_value(port, kind, asked.get(port))})")
        elif direction is Direction.INOUT:
            lines.append(f"    # {port}.set(...), if it writes that port")
    return lines


def _value(name: str, kind: str, asked: str | None = None) -> str:
    """Return the value of an output not filled in yet; `asked`: what a script compares it with."""
    if name in _NO_ERROR:
        return _NO_ERROR[name]
    if kind == "str" and asked == _NUMBER:
        return f'"{_NUMBER}"'
    return asked if asked and kind in ("str", "object") else _VALUES[kind]


def _signature(head: str, parameters: list[str], result: str) -> str:
    text = f"{head}({', '.join(parameters)}) -> {result}:"
    if len(text) <= WIDTH:
        return text
    return "\n".join([f"{head}(", *(f"    {each}," for each in parameters), f") -> {result}:"])


def _ports(
    uses: list[ExpandedNode], model: NodeManifest | None, needs: _Needs
) -> dict[str, tuple[Direction, str, bool]]:
    """Return each port with its direction, its Python type, and whether it may be missing.

    Without a model, a port that only ever points to entries may be written. Ports of the model that
    no node has are omitted.
    """
    found: dict[str, tuple[Direction, str, bool]] = {}
    for port in model.ports.values() if model else ():
        if port.default is None and not any(port.name in use.ports for use in uses):
            continue
        # Editors write an omitted output as an empty text.
        is_written = port.direction is not Direction.INPUT
        given = [
            port.name in use.ports and not (is_written and not use.ports[port.name]) for use in uses
        ]
        missing = not all(given) and port.default is None
        direction, texts = port.direction, [use.ports.get(port.name, "") for use in uses]
        if is_written and any(t and pointer(t, port.name) is None for t in texts):
            # A node with a constant there has nothing to write to.
            direction = Direction.INPUT
        kind = _python_type(port.type) or _guessed(port.name, uses, needs)
        found[port.name] = (direction, kind, missing)
    for name in (name for use in uses for name in use.ports):
        missing = any(name not in use.ports for use in uses)
        texts = [use.element.get(name) for use in uses if name in use.ports]
        is_entry = all(pointer(text, name) is not None for text in texts)
        direction = Direction.INOUT if is_entry else Direction.INPUT
        found.setdefault(name, (direction, _guessed(name, uses, needs), missing))
    return dict(sorted(found.items(), key=lambda item: item[1][2]))


def _guessed(port: str, uses: list[ExpandedNode], needs: _Needs) -> str:
    """Return the type of a port without one: that of the entries that it points to, else a text."""
    texts = [use.ports[port] for use in uses if port in use.ports]
    keys = [pointer(text, port) for text in texts]
    kinds = {needs.kinds[key] for key in keys if key in needs.kinds}
    if len(kinds) != 1:
        return "object" if kinds else "str"
    (kind,) = kinds
    cpp = {"int": "int64_t", "float": "double", "bool": "bool"}.get(kind, "")
    try:
        for text, key in zip(texts, keys, strict=True):
            if key is None:
                read_text(text, cpp)
    except ValueTypeError:
        return "object"
    return kind


def _parameter(name: str, direction: Direction, kind: str, may_miss: bool) -> str:
    shape = {Direction.OUTPUT: "Out", Direction.INOUT: "InOut"}.get(direction, "")
    annotation = f"{shape}[{kind}]" if shape else kind
    return f"{name}: {annotation}" + (" | None = None" if may_miss else "")
