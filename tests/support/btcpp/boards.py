"""Scripts that are run on a blackboard."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mrbt_mesh.btcpp.executor.blackboard import Blackboard
from mrbt_mesh.btcpp.scripts.evaluator import run_script
from mrbt_mesh.btcpp.scripts.parser import parse
from mrbt_mesh.btcpp.scripts.script import Script
from mrbt_mesh.btcpp.scripts.values import type_of_value


def board_of(entries: Mapping[str, Any], parent: Blackboard | None = None) -> Blackboard:
    """An exact blackboard whose entries have the types of their values."""
    board = Blackboard(parent, exact=True)
    for name, value in entries.items():
        board.declare(name, type_of_value(value)).set(value)
    return board


def entries_of(board: Blackboard) -> dict[str, Any]:
    """The entries of this board alone, with their values."""
    return {name: board.read(name) for name in board.names()}


def evaluate(script: Script | str, board: Blackboard, **enums: int) -> Any:
    """The value of a script, which changes the board."""
    return run_script(parse(script) if isinstance(script, str) else script, board, enums)
