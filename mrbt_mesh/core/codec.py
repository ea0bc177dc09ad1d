"""Dataclasses as plain data that JSON can hold, and back, by the types of their fields.

What is read is checked in full: names of fields, types (a bool is no int, nor is 1.0), members of
enums. Texts, whole numbers, bools and None stay as they are, and so does what is `Any`. An enum
becomes its value, a tuple or NamedTuple a list, a dataclass an object without the fields that have
their default. One of several dataclasses that a type admits, or that `Codec` knows for a base
class, is alone in an object under the name of its class. A mapping from texts becomes an object,
sorted by key, in which values do not repeat what is their `KEY`; with `IN_ORDER` the list of its
values. A mapping from anything else becomes a sorted list of pairs.
"""

from __future__ import annotations

import enum
import types
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from functools import partial
from inspect import isabstract
from itertools import compress, count, repeat
from operator import attrgetter, is_not
from typing import Annotated, Any, NamedTuple, TypeAlias, Union

# Metadata of the field of a dataclass that is its key in mappings.
KEY: Mapping[str, bool] = {"key": True}
# Metadata of a field with a default that is left out of plain data.
NOT_WRITTEN: Mapping[str, bool] = {"written": False}
# Of a mapping whose order counts: `Annotated[Mapping[str, Task], IN_ORDER]`.
IN_ORDER = "in order"

_SCALARS = {bool: "true or false", int: "a whole number", str: "a text", types.NoneType: "null"}
_Part: TypeAlias = Callable[[Any], Any]


class DataError(ValueError):
    """Plain data that are no value of a type; the message begins with the path to what is wrong:
    `robots.A1.type: a text expected, not 3`.
    """

    path: tuple[str, ...] = ()

    def __str__(self) -> str:
        return ": ".join(filter(None, (".".join(self.path), *self.args)))

    def below(self, step: Any) -> DataError:
        """The same, seen from one step further above."""
        self.path = (f"{step!s:.80}", *self.path)
        return self


@dataclass(slots=True)
class Form:
    """How values of one type are written as plain data and read; `read` raises DataError. Those
    whose class is in `plain` are plain data themselves, and are neither written nor read.
    """

    write: _Part
    read: _Part
    plain: AbstractSet[type] = frozenset()


class TypesByName(NamedTuple):
    """Annotates a mapping from texts whose values have types of their own: name -> type, None for
    a name that is unknown.
    """

    type_of: Callable[[str], Any]


class StandIn(NamedTuple):
    """The type in whose form another one is written, and the ways there and back.

    `back` may raise ValueError.
    """

    hint: Any
    there: _Part
    back: _Part


@dataclass(frozen=True)
class Codec:
    """Writes and reads values of the types that it is asked for.

    `stand_ins`: types that are written as another one. `classes`: the dataclasses that there are of
    a base class that is none itself.
    """

    stand_ins: Mapping[Any, StandIn] = field(default_factory=dict)
    classes: Callable[[type], Sequence[type]] = lambda _: ()
    _forms: dict[Any, Form] = field(default_factory=dict, init=False, repr=False)

    def write(self, hint: Any, value: Any) -> Any:
        """A value of this type as plain data."""
        return _written(self._form(hint), value)

    def read(self, hint: Any, data: Any) -> Any:
        """The inverse of `write`. Raises DataError, a ValueError, for anything else."""
        form = self._form(hint)
        try:
            return data if type(data) in form.plain else form.read(data)
        except RecursionError:
            raise DataError("nested too deep") from None

    def _form(self, hint: Any) -> Form:
        found = self._forms.get(hint)
        if found is None:
            # It is known before it is made, as a type may have values of its own kind.
            found = self._forms[hint] = Form(_same, _same)
            made = self._make(hint)
            found.write, found.read, found.plain = made.write, made.read, made.plain
        return found

    def _make(self, hint: Any) -> Form:
        origin, arguments = typing.get_origin(hint), typing.get_args(hint)
        if hint in self.stand_ins:
            return self._stand_in(self.stand_ins[hint])
        if hint is Any:
            return Form(_same, _same)
        if origin is Annotated:
            return self._annotated(*arguments)
        if origin in (Union, types.UnionType) or hint in _SCALARS:
            return self._union(arguments or (hint,))
        if origin is tuple:
            is_list = arguments[-1] is Ellipsis
            return self._list(arguments[0]) if is_list else self._row(arguments, tuple)
        if origin is Mapping:
            return self._mapping(*arguments)
        return self._class(hint)

    def _class(self, kind: Any) -> Form:
        if not isinstance(kind, type):
            raise TypeError(f"{kind!r} has no form as plain data")
        if issubclass(kind, enum.Enum):
            return _enum(kind)
        if is_dataclass(kind):
            return self._object(kind)
        if isabstract(kind):
            return self._one_of(lambda: self.classes(kind))
        if issubclass(kind, tuple):
            hints = typing.get_type_hints(kind, include_extras=True)
            return self._row(hints.values(), lambda values: kind(*values))
        raise TypeError(f"{kind!r} has no form as plain data")

    def _stand_in(self, stand_in: StandIn) -> Form:
        form = self._form(stand_in.hint)

        def read(data: Any) -> Any:
            return _made(stand_in.back, data if type(data) in form.plain else form.read(data))

        return Form(lambda value: _written(form, stand_in.there(value)), read)

    def _annotated(self, hint: Any, mark: Any) -> Form:
        if isinstance(mark, TypesByName):
            return self._entries(mark)
        _, inner = typing.get_args(hint)
        key, form = _key_of(inner), self._list(inner)

        def read(data: Any) -> Any:
            return _all_in(((getattr(each, key), each) for each in form.read(data)), data)

        return Form(lambda mapping: form.write(mapping.values()), read)

    def _union(self, hints: Sequence[Any]) -> Form:
        plain = frozenset(_SCALARS).intersection(hints)
        others = [hint for hint in hints if hint not in _SCALARS]
        said = " or ".join(text for kind, text in _SCALARS.items() if kind in plain)
        form = Form(_same, lambda data: _refuse(said, data))
        if others:
            form = self._form(*others) if len(others) == 1 else self._one_of(lambda: others)
        return Form(form.write, form.read, plain)

    def _one_of(self, classes: Callable[[], Sequence[type]]) -> Form:
        def read(data: Any) -> Any:
            known = {kind.__name__: kind for kind in classes()}
            if type(data) is not dict or len(data) != 1 or next(iter(data)) not in known:
                _refuse(f"an object with {' or '.join(known)}", data)
            ((name, given),) = data.items()
            (found,) = _each((name,), (self._form(known[name]),), (given,))
            return found

        return Form(lambda value: {type(value).__name__: self.write(type(value), value)}, read)

    def _list(self, hint: Any) -> Form:
        form = self._form(hint)
        return Form(
            lambda values: [
                each if type(each) in form.plain else form.write(each) for each in values
            ],
            lambda data: tuple(_each(count(), repeat(form), _list_in(data))),
        )

    def _row(self, hints: Iterable[Any], make: _Part) -> Form:
        forms = [self._form(hint) for hint in hints]

        def read(data: Any) -> Any:
            if len(_list_in(data)) != len(forms):
                _refuse(f"a list of {len(forms)}", data)
            return make(_each(count(), forms, data))

        def write(value: Any) -> Any:
            return [_written(form, each) for form, each in zip(forms, value, strict=True)]

        return Form(write, read)

    def _mapping(self, key: Any, inner: Any) -> Form:
        if key is not str:
            pairs = self._list(tuple[key, inner])
            return Form(
                lambda value: pairs.write(sorted(value.items())),
                lambda data: _all_in(pairs.read(data), data),
            )
        form = self._form(inner)
        own = _key_of(inner) if is_dataclass(inner) else ""
        if own:
            form = _without(own, form)

        def read(data: Any) -> Any:
            names = sorted(_object_in(data))
            values = (((name, data[name]) if own else data[name]) for name in names)
            return dict(zip(names, _each(names, repeat(form), values), strict=True))

        return Form(lambda m: {name: _written(form, m[name]) for name in sorted(m)}, read)

    def _entries(self, entries: TypesByName) -> Form:
        def write(value: Any) -> Any:
            return {name: self.write(entries.type_of(name), value[name]) for name in sorted(value)}

        def read(data: Any) -> Any:
            names = sorted(_object_in(data))
            hints = map(entries.type_of, names)
            forms = (_UNKNOWN if hint is None else self._form(hint) for hint in hints)
            return dict(zip(names, _each(names, forms, map(data.get, names)), strict=True))

        return Form(write, read)

    def _object(self, kind: Any) -> Form:
        hints = typing.get_type_hints(kind, include_extras=True)
        own = [each for each in fields(kind) if each.init and each.metadata != NOT_WRITTEN]
        forms = {each.name: self._form(hints[each.name]) for each in own}
        defaults = {each.name: _default_of(each) for each in own}
        rows = [(name, defaults[name], form) for name, form in forms.items()]
        required = {name for name, default in defaults.items() if default is MISSING}
        usual = tuple(defaults.values())
        get = attrgetter(*forms, "__class__")  # of one name alone it would return no tuple
        unknown = Form(_same, partial(_refuse, f"nothing of this name (only {', '.join(forms)})"))

        def write(value: Any) -> Any:
            found, values = {}, get(value)
            changed = compress(zip(rows, values), map(is_not, values, usual))  # noqa: B905
            for (name, default, form), given in changed:
                of = type(given)
                if of in form.plain:
                    if given != default or of is not type(default):
                        found[name] = given
                elif given != default:
                    found[name] = form.write(given)
            return found

        def read(data: Any) -> Any:
            found, name = {}, ""
            _object_in(data)
            try:
                for name, given in data.items():
                    form = forms.get(name, unknown)
                    found[name] = given if type(given) in form.plain else form.read(given)
            except DataError as error:
                raise error.below(name) from None
            for name in sorted(required.difference(found)):
                raise DataError(f"{name!r} is missing")
            return _made(lambda _: kind(**found), None)

        return Form(write, read)


def _enum(kind: type[enum.Enum]) -> Form:
    members = {member.value: member for member in kind}

    def read(data: Any) -> Any:
        is_known = type(data) is str and data in members
        return members[data] if is_known else _refuse(" or ".join(members), data)

    return Form(attrgetter("_value_"), read)  # quicker than the property `value`


def _without(key: str, form: Form) -> Form:
    """A dataclass without its key, which is read from a pair of it and the rest."""

    def write(value: Any) -> Any:
        data = form.write(value)
        del data[key]
        return data

    def read(item: tuple[str, Any]) -> Any:
        name, data = item
        if key in _object_in(data):
            raise DataError(f"{key} is given twice")
        return form.read({key: name, **data})

    return Form(write, read)


def _same(value: Any) -> Any:
    return value


def _written(form: Form, value: Any) -> Any:
    return value if type(value) in form.plain else form.write(value)


def _each(steps: Iterable[Any], forms: Iterable[Form], data: Iterable[Any]) -> list[Any]:
    """The values of parts of data, each in its form. Errors are below the part's step."""
    found: list[Any] = []
    step: Any = None
    try:
        for step, form, item in zip(steps, forms, data, strict=False):  # noqa: B007
            found.append(item if type(item) in form.plain else form.read(item))
    except DataError as error:
        raise error.below(step) from None
    return found


def _made(make: _Part, value: Any) -> Any:
    try:
        return make(value)
    except ValueError as error:
        raise DataError(str(error)) from None


def _refuse(expected: str, data: Any) -> Any:
    raise DataError(f"{expected} expected, not {data!r:.80}")


_UNKNOWN = Form(_same, lambda data: _refuse("nothing of this name", data))


def _object_in(data: Any) -> Any:
    return data if type(data) is dict else _refuse("an object", data)


def _list_in(data: Any) -> Any:
    return data if type(data) is list else _refuse("a list", data)


def _all_in(pairs: Iterable[tuple[Any, Any]], data: Sequence[Any]) -> dict[Any, Any]:
    found = dict(pairs)
    if len(found) != len(data):
        raise DataError("a key is given twice")
    return found


def _key_of(kind: Any) -> str:
    return next((each.name for each in fields(kind) if each.metadata == KEY), "")


def _default_of(known: Any) -> Any:
    return known.default if known.default_factory is MISSING else known.default_factory()
