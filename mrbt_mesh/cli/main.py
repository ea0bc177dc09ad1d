"""The command `mrbt`."""

from __future__ import annotations

import sys


def main() -> None:
    """Entry point. A robot's process is kept small: it imports none of the other commands."""
    if sys.argv[1:2] == ["agent"]:
        from mrbt_mesh.runtime.agent_main import main as agent

        agent(sys.argv[2:])
    from mrbt_mesh.cli.app import app

    app()
