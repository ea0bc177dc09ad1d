"""Parse the arguments of a job on a command line: all in order, or all as NAME=VALUE."""

from __future__ import annotations

from collections.abc import Sequence

from mrbt_mesh.errors import InputError


def arguments_in(words: Sequence[str]) -> list[str] | dict[str, str]:
    """Return the values in order, or by parameter; a value cannot contain `=`.

    Raises InputError for a mixture of both, and for a name that is given twice.
    """
    named = [word for word in words if "=" in word]
    if not named:
        return list(words)
    if len(named) < len(words):
        plain = next(word for word in words if "=" not in word)
        raise InputError(
            f"{named[0]!r:.80} has a name and {plain!r:.80} has none: give all arguments in order "
            "(shelf_2 dock_1 3), or all as NAME=VALUE (shelf=shelf_2 dock=dock_1 boxes=3)"
        )
    found: dict[str, str] = {}
    for word in words:
        name, _, value = word.partition("=")
        if name in found:
            raise InputError(f"{name!r:.80} is given twice: {found[name]!r:.80} and {value!r:.80}")
        found[name] = value
    return found
