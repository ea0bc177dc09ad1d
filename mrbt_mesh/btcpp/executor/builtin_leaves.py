"""BehaviorTree.CPP's own leaves, except Sleep, which waits (see `timed`)."""

from __future__ import annotations

from typing import Any

from mrbt_mesh.btcpp.executor.blackboard import BlackboardError
from mrbt_mesh.btcpp.executor.node import FAILURE, SUCCESS, NodeStatus, TickError, TreeNode
from mrbt_mesh.btcpp.files.document import pointer
from mrbt_mesh.btcpp.scripts.parser import parse
from mrbt_mesh.btcpp.scripts.script import Script, ScriptError
from mrbt_mesh.btcpp.scripts.values import ANY_TYPE, ValueTypeError, read_text, type_of_value


class Always(TreeNode):
    """AlwaysSuccess and AlwaysFailure."""

    __slots__ = ()

    def tick(self) -> NodeStatus:
        self.world.count_leaf(self.place)
        return SUCCESS if self.type == "AlwaysSuccess" else FAILURE


class ScriptLeaf(TreeNode):
    """Script and ScriptCondition; the code may come from the blackboard."""

    __slots__ = ("script", "text")

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.text = ""
        self.script: Script | None = None

    def tick(self) -> NodeStatus:
        self.world.count_leaf(self.place)
        text = str(self.input("code"))
        if self.script is None or text != self.text:
            try:
                self.text, self.script = text, parse(text)
            except ScriptError as error:
                raise TickError(f"{self.place}: {error}, in the script {text!r}") from None
        if self.type == "ScriptCondition":
            return SUCCESS if self.holds(self.script) else FAILURE
        self.evaluate(self.script)
        return SUCCESS


class SetBlackboard(TreeNode):
    """Writes `value`, a constant text or another entry, to the entry named by `output_key`."""

    __slots__ = ()

    def tick(self) -> NodeStatus:
        self.world.count_leaf(self.place)
        name, text = self._target(), self.ports.get("value")
        if text is None:
            raise TickError(f"{self.place}: port 'value' is missing")
        key = pointer(text, "value")
        value: Any = text
        type_name = ""
        if key is not None:
            entry = self.board.find(key)
            if entry is None:
                raise TickError(f"{self.place}: port 'value': there is no entry {key!r}")
            value, type_name = entry.value, entry.type or type_of_value(entry.value)
        if value is None:
            return FAILURE
        target = self.board.declare(name, type_name)
        is_typed = target.type not in ("", ANY_TYPE)
        if self.board.exact and target.type == ANY_TYPE and isinstance(value, str):
            message = f"the entry {name!r} is of type {ANY_TYPE}, to which no text is converted"
            raise TickError(f"{self.place}: {message}")
        if isinstance(value, str) and is_typed and target.type != "std::string":
            try:
                value = read_text(value, target.type, self.world.enums)
            except ValueTypeError as error:
                raise TickError(f"{self.place}: the entry {name!r}: {error}") from None
        elif key is not None and self.board.exact and is_typed and target.type != type_name:
            raise TickError(
                f"{self.place}: the entry {name!r} is of type {target.type}, and {key!r} of type "
                f"{type_name}"
            )
        try:
            self.board.put(name, value)
        except BlackboardError as error:
            raise TickError(f"{self.place}: {error}") from None
        return SUCCESS

    def _target(self) -> str:
        """Return the name of the entry to write; a name in braces refers to an entry holding it."""
        key = pointer(self.ports.get("output_key", ""), "output_key")
        if key is not None and self.board.read(key) is None:
            raise TickError(
                f"{self.place}: port 'output_key': the entry {key!r} has no value; it would hold "
                f'the name of the entry to set. To set {key!r} itself write output_key="{key}"'
            )
        return str(self.input("output_key"))


class UnsetBlackboard(TreeNode):
    """Removes the entry named by `key`."""

    __slots__ = ()

    def tick(self) -> NodeStatus:
        self.world.count_leaf(self.place)
        self.board.unset(str(self.input("key")))
        return SUCCESS


class WasEntryUpdated(TreeNode):
    """Returns SUCCESS if an entry was written since the last SUCCESS, else FAILURE."""

    __slots__ = ("seen",)

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.seen = 0

    def tick(self) -> NodeStatus:
        self.world.count_leaf(self.place)
        entry = self.board.find(self.key("entry"))
        if entry is None or entry.writes == self.seen:
            return FAILURE
        self.seen = entry.writes
        return SUCCESS


BUILTIN_LEAVES: dict[str, type[TreeNode]] = {
    "AlwaysSuccess": Always,
    "AlwaysFailure": Always,
    "Script": ScriptLeaf,
    "ScriptCondition": ScriptLeaf,
    "SetBlackboard": SetBlackboard,
    "UnsetBlackboard": UnsetBlackboard,
    "WasEntryUpdated": WasEntryUpdated,
}
