"""The command `mrbt`."""

from __future__ import annotations

from mrbt_mesh.cli.app import app


def main() -> None:
    """Entry point."""
    app()
