"""What `mrbt top` needs."""

from __future__ import annotations

from mrbt_mesh.errors import InputError

EXTRA = "top"
NEEDED = ("textual",)


def check() -> None:
    """Raises InputError without the extra, and without a terminal."""
    import sys
    from importlib.util import find_spec

    if any(find_spec(name) is None for name in NEEDED):
        raise InputError(f"mrbt top needs more: pip install 'mrbt-mesh[{EXTRA}]'")
    # textual draws on standard error.
    if not all(stream.isatty() for stream in (sys.stdin, sys.stdout, sys.stderr)):
        raise InputError("mrbt top needs a terminal; mrbt watch --headless prints lines")
