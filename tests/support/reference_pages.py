"""The reference of commands and of the Python API, as Markdown that needs no tool to be read.

python -m tests.support.reference_pages      # writes both pages anew: `make reference`
"""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from types import ModuleType
from typing import Any, Generic, Protocol

import click

from mrbt_mesh.cli.main import main
from tests.support.paths import ROOT

FOLDER = ROOT / "docs" / "reference"
MADE = "<!-- Made by `make reference` from {}: change them, not this page. -->"
API = {
    "mrbt_mesh": "Robot programs",
    "mrbt_mesh.btcpp": "Trees of one robot",
    "mrbt_mesh.testing": "Tests of missions",
}
WIDTH = 90


# -- commands -----------------------------------------------------------------------------------


def commands_page() -> str:
    """What `--help` prints of each command."""
    parts = ["# Commands", MADE.format("the commands' own help"), *_commands(main, "mrbt", None)]
    return "\n\n".join(parts) + "\n"


def _commands(command: click.Command, name: str, parent: click.Context | None) -> Iterator[str]:
    context = click.Context(
        command, parent, info_name=name.split()[-1], terminal_width=WIDTH, max_content_width=WIDTH
    )
    text = "\n".join(line.rstrip() for line in command.get_help(context).splitlines())
    yield f"## {name}\n\n```text\n{text}\n```"
    if isinstance(command, click.Group):
        for each in command.list_commands(context):
            found = command.get_command(context, each)
            if found is not None and not found.hidden:
                yield from _commands(found, f"{name} {each}", context)


# -- Python -------------------------------------------------------------------------------------


def api_page() -> str:
    """Signatures and docstrings of what may be imported."""
    parts = ["# Python API", MADE.format("docstrings")]
    for name, title in API.items():
        module = importlib.import_module(name)
        parts += [f"## {title}", f"`import {name}`", _doc(module)]
        for public in sorted(each for each in module.__all__ if not each.startswith("_")):
            parts += _described(module, public)
    return "\n\n".join(part for part in parts if part) + "\n"


def _described(module: ModuleType, name: str) -> Iterator[str]:
    value = getattr(module, name)
    yield f"### {name}"
    if inspect.isclass(value):
        yield _class(name, value)
        yield _doc(value)
        for member, found in vars(value).items():
            yield from _member(name, member, found)
    elif callable(value) and hasattr(value, "__module__") and inspect.isroutine(value):
        is_async = inspect.iscoroutinefunction(value)
        yield _code(f"{'async ' if is_async else ''}def {name}", _signature(value))
        yield _doc(value)
    else:
        yield f"```python\n{name} = {_plain(repr(value))}\n```"


def _member(owner: str, name: str, found: Any) -> Iterator[str]:
    """A method or a property that has a docstring."""
    function = found.fget if isinstance(found, property) else getattr(found, "__func__", found)
    is_shown = inspect.isfunction(function) or inspect.iscoroutinefunction(function)
    if name.startswith("_") or not is_shown or not function.__doc__:
        return
    is_async = inspect.iscoroutinefunction(function)
    yield f"#### {owner}.{name}"
    if isinstance(found, property):
        kind = function.__annotations__.get("return", "Any")
        yield f"```python\n{name}: {_plain(str(kind))}\n```"
    else:
        yield _code(f"{'async ' if is_async else ''}def {name}", _signature(function))
    yield _doc(function)


def _class(name: str, value: type) -> str:
    """Its bases, and how one is made, unless that is for the package alone; of an enumeration its
    members.
    """
    hidden = object, Protocol, Generic
    bases = ", ".join(each.__name__ for each in value.__bases__ if each not in hidden)
    lines, signature = [f"class {name}({bases})" if bases else f"class {name}"], _signature(value)
    if issubclass(value, Enum):
        lines += [f"    {each.name} = {each.value!r}" for each in value]
    elif signature not in ("", "()", "(*args, **kwargs)") and not re.search(
        r"[( ]_\w+: ", signature
    ):
        lines.append(name + signature)
    return "```python\n" + "\n".join(lines) + "\n```"


def _signature(value: Any) -> str:
    try:
        signature = inspect.signature(value)
    except ValueError:  # as of an enumeration
        return ""
    parameters = [each for name, each in signature.parameters.items() if name != "self"]
    if isinstance(value, type):
        signature = signature.replace(return_annotation=inspect.Signature.empty)
    whole = _plain(str(signature.replace(parameters=parameters)))
    if len(whole) <= WIDTH - 20:
        return whole
    lines, is_named = [], False
    for each in parameters:
        if each.kind is each.KEYWORD_ONLY and not is_named:
            lines.append("*")
        is_named = is_named or each.kind in (each.KEYWORD_ONLY, each.VAR_POSITIONAL)
        lines.append(_plain(str(each)))
    end = whole[whole.rindex(")") :] if ") ->" not in whole else whole[whole.rindex(") ->") :]
    return "(\n    " + ",\n    ".join(lines) + ",\n" + end


def _plain(text: str) -> str:
    """Names without their modules; annotations are texts."""
    text = re.sub(r"<(?:factory|[^<>]*(?:<[^<>]*>)?[^<>]* at 0x[0-9a-f]+)>", "...", text)
    text = re.sub(r"(: |-> )'((?:[^'\\]|\\.)*)'", r"\1\2", text)
    return re.sub(
        r"\b(?:mrbt_mesh|typing|collections\.abc|pathlib|datetime)(?:\.\w+)*\.(\w)", r"\1", text
    )


def _code(head: str, signature: str) -> str:
    return f"```python\n{head}{signature}\n```"


def _doc(value: Any) -> str:
    return inspect.cleandoc(value.__doc__ or "")


PAGES = {"commands.md": commands_page, "api.md": api_page}


def write(folder: Path) -> None:
    """Write the pages."""
    for name, page in PAGES.items():
        (folder / name).write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    write(FOLDER)
