"""Commands of operators, as their clients make them."""

from __future__ import annotations

from typing import Any

from mrbt_mesh.core.agent.operator_messages import command_version
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.membership.keys import Keys, make_command
from tests.support import build


def command(
    name: str,
    value: Any,
    stamp: int = 1,
    command_id: str = "c",
    operator: str = "op",
    keys: Keys | None = None,
    run: str = build.RUN,
) -> Entry:
    """`name`: a field and its subject; `value`: plain data."""
    return make_command(name, value, operator, command_version(stamp, command_id), run, keys)


def submission(
    job_id: str,
    kind: str,
    *arguments: str,
    priority: int = 0,
    not_before_us: int = 0,
    deadline_us: int = 0,
    content: int = 0,
    stamp: int = 1,
    command_id: str = "c",
    operator: str = "me",
) -> Entry:
    """A job that is submitted."""
    value = [kind, list(arguments), priority, not_before_us, deadline_us, content]
    return command(f"job/{job_id}", value, stamp, command_id, operator)
