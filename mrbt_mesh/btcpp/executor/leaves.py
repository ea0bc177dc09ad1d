"""The leaves of a robot: Python functions registered by the names that trees use.

    leaves = Leaves()

    @leaves.action("MoveTo")
    async def move_to(goal: str, speed: float = 0.5) -> None:
        await base.drive(goal, speed)          # raise TaskFailedError, or return False: FAILURE

    @leaves.action("Detect")
    async def detect(pose: Out[str]) -> None:
        pose.set(await camera.find())          # an output port

    @leaves.condition("BatteryOk")
    def battery_ok(minimum: float) -> bool:
        return battery.charge >= minimum

A parameter is an input port with its type and default. `Out[T]` is an output port, `InOut[T]` is
both; `Out[T] | None = None` is an output port that a file may omit. `**ports` takes all other
ports.
"""

from __future__ import annotations

import inspect
import types
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from mrbt_mesh.btcpp.executor.node import Source, TreeNode
from mrbt_mesh.btcpp.files.document import Category
from mrbt_mesh.btcpp.scripts.values import CPP_TYPES
from mrbt_mesh.errors import InputError

T = TypeVar("T")
F = TypeVar("F", bound=Callable[..., Any])
N = TypeVar("N", bound=type[TreeNode])


class LeafError(InputError, ValueError):
    """A function that cannot be a leaf, or a leaf that is registered twice."""


class Out(Generic[T]):
    """An output port: `set` immediately writes the entry that the port points to."""

    def __init__(self, write: Callable[[Any], None]) -> None:
        self._write = write

    def set(self, value: T) -> None:
        """Write the entry. Raises TickError if the port has no entry, or the type is wrong."""
        self._write(value)


class InOut(Out[T]):
    """A port that is read and written.

    `value` is the entry's value when the leaf started, None if it had none.
    """

    def __init__(self, write: Callable[[Any], None], value: T) -> None:
        super().__init__(write)
        self.value = value


@dataclass(frozen=True, slots=True)
class LeafPort:
    """One port: its C++ type (empty: any), its directions, and whether it may be missing.

    `has_value`: it has a default other than None.
    """

    type: str = ""
    reads: bool = True
    writes: bool = False
    is_optional: bool = False
    has_value: bool = field(default=False, compare=False)


@dataclass(frozen=True, slots=True)
class Leaf:
    """One registered function. `takes_type`: its first argument is the leaf's type.

    `takes_others`: it takes ports that it does not name. `given`: the types of the parameters that
    are not ports, by name.
    """

    name: str
    category: Category
    function: Callable[..., Any]
    ports: Mapping[str, LeafPort] = field(default_factory=dict)
    takes_others: bool = False
    takes_type: bool = False
    given: Mapping[str, type] = field(default_factory=dict)

    @property
    def is_async(self) -> bool:
        """True for an asynchronous action, which may take time."""
        is_coroutine = inspect.iscoroutinefunction(self.function)
        return self.category is Category.ACTION and is_coroutine


@dataclass(frozen=True, slots=True)
class ProgramValue:
    """A function of the program that returns a value. `given`: the types of its parameters."""

    function: Callable[..., Any]
    given: Mapping[str, type]

    def bound(self, values: Mapping[type, Any]) -> Source:
        """Return the function with its arguments bound; they are looked up at each call."""
        return lambda: self.function(**{name: values[kind] for name, kind in self.given.items()})


class Leaves:
    """A registry of leaves, which any number of trees may share.

    A parameter of one of the types `given` is not a port: the tree supplies its value. The registry
    also holds what the program provides to trees: `entries` and `sources` by name, and `enums`, the
    numbers that names in scripts stand for.
    """

    def __init__(self, *given: type) -> None:
        self._given = given
        self._leaves: dict[str, Leaf] = {}
        self.node_types: dict[str, type[TreeNode]] = {}
        self.entries: dict[str, ProgramValue] = {}
        self.sources: dict[str, ProgramValue] = {}
        self.enums: dict[str, int] = {}

    def action(self, name: str) -> Callable[[F], F]:
        """Register an action: an async function, or a plain one that ends within a tick.

        It succeeds unless it returns False or NodeStatus.FAILURE, or raises TaskFailedError. The
        name `"*"` registers a function for all types without one of their own; its first argument,
        positional-only, is the type. Raises LeafError.
        """
        return self._register(name, Category.ACTION)

    def condition(self, name: str) -> Callable[[F], F]:
        """Register a condition: a function that returns True or False at once.

        It may be async but must not wait: work that takes time belongs in an action, or in a task
        of the program that keeps a value up to date. Raises LeafError.
        """
        return self._register(name, Category.CONDITION)

    def node(self, name: str) -> Callable[[N], N]:
        """Register a control or decorator: a subclass of TreeNode. Raises LeafError.

        CHILDREN is the allowed number of children, and `tick` its logic (see the modules `controls`
        and `decorators` for examples). It must not wait, and must read time only from its world.
        """

        def register(node_type: N) -> N:
            if not (inspect.isclass(node_type) and issubclass(node_type, TreeNode)):
                raise LeafError(f"the node {name!r}: {node_type!r} is not a subclass of TreeNode")
            if node_type.tick is TreeNode.tick:
                raise LeafError(f"the node {name!r}: {node_type.__name__} has no method tick")
            if name in self.node_types:
                raise LeafError(f"the node {name!r} is registered twice")
            self.node_types[name] = node_type
            return node_type

        return register

    def entry(self, name: str) -> Callable[[F], F]:
        """Register a function that sets an entry of the outermost tree before each tick.

        Use it for values that a tree only reads, from a sensor or another part of the program. If
        it returns None, the entry stays as it is. Raises LeafError.
        """
        return self._register_value(name.removeprefix("@"), "entry", self.entries)

    def source(self, name: str) -> Callable[[F], F]:
        """Register a value for Nav2's nodes: `robot_pose`, `robot_speed`, `goal_update`, `paused`.

        Raises LeafError.
        """
        return self._register_value(name, "source", self.sources)

    def _register_value(
        self, name: str, kind: str, values: dict[str, ProgramValue]
    ) -> Callable[[F], F]:
        def register(function: F) -> F:
            leaf = leaf_of(name, Category.ACTION, function, self._given)
            if leaf.is_async or leaf.ports or leaf.takes_others or leaf.takes_type:
                raise LeafError(f"the {kind} {name!r}: a plain function without ports is expected")
            if name in values:
                raise LeafError(f"the {kind} {name!r} is registered twice")
            values[name] = ProgramValue(function, leaf.given)
            return function

        return register

    def find(self, name: str) -> Leaf | None:
        """Return the leaf of this type, else the leaf `"*"`, else None."""
        return self._leaves.get(name) or self._leaves.get("*")

    def with_conditions(self, conditions: Mapping[str, Callable[..., bool]]) -> Leaves:
        """Return a copy with these conditions added, except where a function has the same name.

        Raises LeafError.
        """
        result = Leaves(*self._given)
        result.node_types, result.enums = self.node_types, self.enums
        result.entries, result.sources = self.entries, self.sources
        for name, function in conditions.items():
            result.condition(name)(function)
        result._leaves |= self._leaves
        return result

    def names(self) -> list[str]:
        """Return the registered types, sorted."""
        return sorted([*self._leaves, *self.node_types])

    def _register(self, name: str, category: Category) -> Callable[[F], F]:
        if not isinstance(name, str) or not name:
            given = getattr(name, "__name__", "NAME")
            raise LeafError(f'a leaf needs a name: write @...{category.lower()}("{given}")')

        def register(function: F) -> F:
            if name in self._leaves:
                raise LeafError(f"the leaf {name!r} is registered twice")
            self._leaves[name] = leaf_of(name, category, function, self._given)
            return function

        return register


def leaf_of(
    name: str, category: Category, function: Callable[..., Any], given: tuple[type, ...] = ()
) -> Leaf:
    """Make a leaf from a function; its parameters become ports. Raises LeafError."""
    if not callable(function) or inspect.isclass(function):
        raise LeafError(f"the leaf {name!r}: {function!r} is not a function")
    try:
        hints = typing.get_type_hints(function)
    except Exception as error:
        raise LeafError(f"the leaf {name!r}: its annotations cannot be read: {error}") from None
    ports: dict[str, LeafPort] = {}
    others: dict[str, type] = {}
    takes_others = takes_type = False
    for parameter in inspect.signature(function).parameters.values():
        if parameter.kind is inspect.Parameter.VAR_KEYWORD:
            takes_others = True
        elif parameter.kind is inspect.Parameter.POSITIONAL_ONLY and not takes_type:
            takes_type = True
        elif hints.get(parameter.name) in given:
            others[parameter.name] = hints[parameter.name]
        elif parameter.kind in (parameter.POSITIONAL_OR_KEYWORD, parameter.KEYWORD_ONLY):
            ports[parameter.name] = _port(hints.get(parameter.name), parameter.default)
        else:
            raise LeafError(f"the leaf {name!r}: {parameter} cannot be a port")
    return Leaf(name, category, function, ports, takes_others, takes_type, others)


def _port(annotation: Any, default: Any) -> LeafPort:
    has_default = default is not inspect.Parameter.empty
    if typing.get_origin(annotation) in (typing.Union, types.UnionType):
        parts = [part for part in typing.get_args(annotation) if part is not type(None)]
        annotation = parts[0] if len(parts) == 1 else None
    origin = typing.get_origin(annotation) or annotation
    arguments = typing.get_args(annotation)
    if origin in (Out, InOut):
        inner = arguments[0] if arguments else None
        return LeafPort(_type_name(inner), origin is InOut, True, has_default)
    has_value = has_default and default is not None
    return LeafPort(_type_name(annotation), is_optional=has_default, has_value=has_value)


def _type_name(annotation: Any) -> str:
    if typing.get_origin(annotation) is list:
        (inner,) = typing.get_args(annotation)
        return f"list<{_type_name(inner) or 'std::string'}>"
    return CPP_TYPES.get(annotation, "") if isinstance(annotation, type) else ""
