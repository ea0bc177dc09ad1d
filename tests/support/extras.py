"""What is said where an extra is not installed."""

from __future__ import annotations

import subprocess
import sys

PROGRAM = """
import sys; sys.modules[{library!r}] = None
from mrbt_mesh.errors import InputError
from {module} import {name}
try: {call}
except InputError as error: print(error)
"""


def said_without(library: str, module: str, call: str) -> str:
    """The InputError that a call of a function of `module` raises without a library, or nothing."""
    name = call.partition("(")[0]
    program = PROGRAM.format(library=library, module=module, name=name, call=call)
    words = [sys.executable, "-c", program]
    return subprocess.run(words, capture_output=True, text=True, check=True).stdout
