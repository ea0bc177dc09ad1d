"""What local tasks and conditions are in ROS: bindings, and what is made of one for a task.

Values in, values out. `$name` in a text is a robot's value or a parameter of the local task; a text
that is nothing else becomes the value itself: of a parameter with a table what stands there for the
argument, and `$place.x` a part of it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from string import Template
from typing import Any, Literal, TypeAlias

from mrbt_mesh.adapters.ros2.expression import MessageExpression
from mrbt_mesh.errors import nearest
from mrbt_mesh.formats.problems import SourcePath

Kind: TypeAlias = Literal["action", "srv", "msg"]
Tables: TypeAlias = Mapping[str, Mapping[str, Any]]

_WHOLE = re.compile(r"\$([A-Za-z_]\w*)((?:\.\w+)*)")


class FillError(Exception):
    """A task's arguments do not lead to a message; the text says why."""


@dataclass(frozen=True)
class TopicBinding:
    """What is read of a topic. `latched`: its newest message is kept for those who come later."""

    topic: str
    type: str
    expressions: Mapping[str, MessageExpression]
    latched: bool


@dataclass(frozen=True)
class TaskBinding:
    """A local task's action, service or topic, and what its messages mean."""

    kind: Kind
    name: str
    type: str
    parameters: tuple[str, ...]
    body: Mapping[str, Any]
    progress: MessageExpression | None
    success: MessageExpression | None
    reason: MessageExpression | None
    sets: Mapping[str, bool | MessageExpression]
    within_s: float | None
    lifecycle: str | None
    until: TopicBinding | None
    on_cancel: Mapping[str, Any] | None


@dataclass(frozen=True)
class FilledBinding:
    """A ground local task: the message, and the conditions that it sets."""

    body: Any
    on_cancel: Any
    sets: Mapping[str, bool | MessageExpression]


@dataclass(frozen=True)
class KnownValues:
    """What `$name` stands for: robots' values, arguments, and the tables of their meanings."""

    values: Mapping[str, str]
    tables: Tables

    def text(self, text: str) -> str:
        """A text with values in it."""
        return Template(text).safe_substitute(self.values)

    def data(self, data: Any) -> Any:
        """Plain data with values in it; what is not known keeps its `$`. Raises FillError."""
        if isinstance(data, str):
            whole = _WHOLE.fullmatch(data)
            return self._whole(whole[1], whole[2], data) if whole else self.text(data)
        if isinstance(data, Mapping):
            return {key: self.data(value) for key, value in data.items()}
        if isinstance(data, list):
            return [self.data(value) for value in data]
        return data

    def _whole(self, name: str, path: str, text: str) -> Any:
        if name not in self.values:
            return text
        argument = self.values[name]
        table = self.tables.get(name)
        if table is None:
            if path:
                raise FillError(f"{text}: values has no table for {name}")
            return argument
        if argument not in table:
            raise FillError(f"values/{name} has no {argument!r}{nearest(argument, table)}")
        value = table[argument]
        for key in path.split(".")[1:]:
            if not isinstance(value, Mapping) or key not in value:
                known = value if isinstance(value, Mapping) else ()
                raise FillError(f"{text}: {argument} has no {key!r}{nearest(key, known)}")
            value = value[key]
        return value


def filled(
    binding: TaskBinding, robot_values: Mapping[str, str], arguments: Sequence[str], tables: Tables
) -> FilledBinding:
    """What a ground local task is in ROS. Raises FillError."""
    if len(arguments) != len(binding.parameters):
        wanted = ", ".join(binding.parameters) or "none"
        raise FillError(f"the binding has other parameters: {wanted}")
    values = {**robot_values, **dict(zip(binding.parameters, arguments, strict=True))}
    known = KnownValues(values, tables)
    sets = {known.text(name): value for name, value in binding.sets.items()}
    on_cancel = None if binding.on_cancel is None else known.data(binding.on_cancel)
    return FilledBinding(known.data(binding.body), on_cancel, sets)


def bodies_to_check(
    binding: TaskBinding, place: SourcePath, tables: Tables
) -> list[tuple[SourcePath, Any]]:
    """The messages that a binding may become, as far as they are known, each with where it stands:
    as written, and with each value of a table in turn. `lacking_parts` has found nothing.
    """
    key = {"action": "goal", "srv": "request", "msg": "message"}[binding.kind]
    written = {key: binding.body}
    if binding.on_cancel is not None:
        written["on_cancel"] = binding.on_cancel
    found: list[tuple[SourcePath, Any]] = []
    for part, body in written.items():
        found.append(((*place, part), body))
        for name in binding.parameters:
            for argument in tables.get(name, {}):
                made = KnownValues({name: argument}, tables).data(body)
                if made != body:
                    found.append((("values", name, argument), made))
    return found


def lacking_parts(binding: TaskBinding, tables: Tables) -> list[tuple[SourcePath, str]]:
    """What the message asks of tables that they do not have: where, and a message."""
    found: list[tuple[SourcePath, str]] = []
    for name in binding.parameters:
        for argument in tables.get(name, {}):
            try:
                KnownValues({name: argument}, tables).data([binding.body, binding.on_cancel])
            except FillError as error:
                found.append((("values", name, argument), str(error)))
    return found
