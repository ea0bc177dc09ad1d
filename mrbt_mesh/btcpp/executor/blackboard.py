"""Blackboards: entries with types and write counts. Each SubTree has a board, remapped to a parent.

Source: BehaviorTree.CPP's `Blackboard`. Raises BlackboardError.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from mrbt_mesh.btcpp.scripts.values import (
    ANY_TYPE,
    INTEGERS,
    REALS,
    ValueTypeError,
    as_type,
    read_text,
    type_of_value,
)

# BehaviorTree.CPP converts numbers when nothing is lost, except for these: (type, new type).
_NEVER_SAFE = {
    *(("bool", other) for other in ("int", "int64_t", "double")),
    *((other, "bool") for other in ("int", "int64_t")),
}


class BlackboardError(ValueError):
    """An entry that does not exist, or a value that it cannot hold."""


class BoardEntry:
    """One entry. `writes` counts how often it was set; it has no value until then."""

    __slots__ = ("is_declared", "type", "value", "writes")

    def __init__(self, type_name: str = "") -> None:
        self.type = type_name
        # True if a port has declared its type, rather than the first value.
        self.is_declared = bool(type_name)
        self.value: Any = None
        self.writes = 0

    def set(self, value: Any) -> None:
        """Store a value without converting it."""
        self.value = value
        self.writes += 1


class Blackboard:
    """The entries of one tree.

    `remapped` maps names on this board to the parent's entries. With `autoremap`, every other name
    that does not begin with `_` is the parent's as well. `@name` is an entry of the root's board.

    An entry gets its type from the first port that names it, or from the first value it is given; a
    text gives it no type. `exact`: a type never changes, as in BehaviorTree.CPP. Otherwise a port's
    type replaces that of a value, and an entry that no port names accepts values of any type.

        board["goal"] = "dock"
        board.get("battery", 1.0)
    """

    def __init__(
        self, parent: Blackboard | None = None, autoremap: bool = False, *, exact: bool = False
    ) -> None:
        self.parent = parent
        self.exact = exact
        self.autoremap = autoremap
        self.remapped: dict[str, str] = {}
        self._entries: dict[str, BoardEntry] = {}
        self._watchers: list[Callable[[], None]] = []

    @property
    def root(self) -> Blackboard:
        """The board of the outermost tree."""
        board = self
        while board.parent is not None:
            board = board.parent
        return board

    # -- as nodes and scripts see it ----------------------------------------------------------

    def find(self, name: str) -> BoardEntry | None:
        """Return the entry of this name on this or an outer board.

        None if it was neither declared nor written.
        """
        if name.startswith("@"):
            return self.root.find(name[1:])
        board: Blackboard = self
        while True:
            entry = board._entries.get(name)
            if entry is not None or board.parent is None:
                return entry
            outer = board._outer_name(name)
            if outer is None:
                return None
            board, name = board.parent, outer
            if name.startswith("@"):
                return board.root.find(name[1:])

    def _outer_name(self, name: str) -> str | None:
        if name in self.remapped:
            return self.remapped[name]
        return name if self.autoremap and not name.startswith("_") else None

    def declare(self, name: str, type_name: str = "") -> BoardEntry:
        """Return the entry of this name; create it on the board it belongs to if needed."""
        if name.startswith("@"):
            return self.root.declare(name[1:], type_name)
        entry = self._entries.get(name)
        if entry is None:
            outer = self._outer_name(name) if self.parent is not None else None
            if outer is not None and self.parent is not None:
                return self.parent.declare(outer, type_name)
            entry = self._entries[name] = BoardEntry(type_name)
        elif type_name and not entry.is_declared and not self.exact:
            self._retype(name, entry, type_name)
        return entry

    def _retype(self, name: str, entry: BoardEntry, type_name: str) -> None:
        """Replace the type that an entry got from a value by that of a port, if it can convert."""
        try:
            value = converted(name, entry.value, type_name)
        except BlackboardError:
            return
        entry.type, entry.is_declared, entry.value = type_name, True, value

    def put(self, name: str, value: Any) -> None:
        """Set an entry, converted to its type. Raises BlackboardError if that is not possible."""
        is_new = self.find(name) is None
        entry = self.declare(name)
        if entry.type in ("", ANY_TYPE) and not (is_new and isinstance(value, str)):
            entry.type = type_of_value(value)
        try:
            if self.exact and not _is_safe(entry.type, value):
                raise BlackboardError(f"the entry {name!r} is of type {entry.type}, not {value!r}")
            kept = converted(name, value, entry.type)
        except BlackboardError:
            if self.exact or entry.is_declared:
                raise
            entry.type, kept = type_of_value(value), value
        entry.set(kept)

    def own(self, name: str, value: Any) -> None:
        """Set an entry of this board itself, ignoring remapping."""
        entry = self._entries.setdefault(name, BoardEntry())
        entry.type = "" if isinstance(value, str) else type_of_value(value)
        entry.set(value)

    # -- as scripts see it: `evaluator.Entries` -----------------------------------------------

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and self.find(name) is not None

    def read(self, name: str) -> Any:
        entry = self.find(name)
        return None if entry is None else entry.value

    def type_of(self, name: str) -> str:
        entry = self.find(name)
        is_any = entry is None or (entry.type == ANY_TYPE and not self.exact)
        return "" if entry is None or is_any else entry.type

    def write(self, name: str, value: Any) -> None:
        self.declare(name).set(value)

    # -- as programs see it -------------------------------------------------------------------

    def __getitem__(self, name: str) -> Any:
        entry = self.find(name)
        if entry is None or entry.value is None:
            raise BlackboardError(f"there is no blackboard entry {name!r}")
        return entry.value

    def __setitem__(self, name: str, value: Any) -> None:
        self.put(name, value)
        for watcher in self.root._watchers:
            watcher()

    def get(self, name: str, default: Any = None) -> Any:
        """Return the value of an entry, or `default` if it has none."""
        value = self.read(name)
        return default if value is None else value

    def unset(self, name: str) -> None:
        """Remove an entry from this or an outer board; does nothing if there is none.

        With `exact`, as in BehaviorTree.CPP, an entry of the parent stays.
        """
        if name.startswith("@"):
            self.root.unset(name[1:])
        elif name in self._entries:
            del self._entries[name]
        elif not self.exact and self.parent is not None:
            outer = self._outer_name(name)
            if outer is not None:
                self.parent.unset(outer)

    def names(self) -> Iterator[str]:
        """Return the names of this board's own entries, sorted."""
        return iter(sorted(self._entries))

    def keys(self) -> list[str]:
        """Return the names of this board's own entries that have a value, sorted.

        `dict(board)` returns names and values.
        """
        return [name for name in self.names() if self._entries[name].value is not None]

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())

    def __len__(self) -> int:
        return len(self.keys())

    def __bool__(self) -> bool:
        return True

    def watch(self, watcher: Callable[[], None]) -> None:
        """Call `watcher` whenever the program, not a node, sets an entry."""
        self.root._watchers.append(watcher)


def _is_safe(type_name: str, value: Any) -> bool:
    """Return whether BehaviorTree.CPP converts this value to the type; it does for numbers only."""
    given = type_of_value(value)
    if given in ("", "std::string") or type_name in ("", "std::string", given):
        return True
    is_number = type_name in INTEGERS or type_name in REALS or type_name == "bool"
    return is_number and (type_name, given) not in _NEVER_SAFE


def converted(name: str, value: Any, type_name: str) -> Any:
    """Convert `value` to the type of an entry. Raises BlackboardError."""
    if not type_name or value is None:
        return value
    try:
        if isinstance(value, str):
            return read_text(value, type_name)
        if type_name != "std::string":
            return as_type(value, type_name)
    except ValueTypeError as error:
        raise BlackboardError(f"the entry {name!r} is of type {type_name}: {error}") from None
    raise BlackboardError(f"the entry {name!r} holds a text, not {value!r}")
