"""Output that cannot be written."""

from __future__ import annotations

import subprocess
import sys

PROGRAM = """
import click
from mrbt_mesh.cli.command import end_process
from mrbt_mesh.cli.streams import lose_output_rather_than_end
from mrbt_mesh.cli.terminal import console, note, print_json
lose_output_rather_than_end()
for number in range(5_000):
    click.echo(f"line {number}")
console.print("text")
print_json({"a": 1})
note("on stderr")
end_process(7)
"""


def test_it_ends_nothing() -> None:
    """A pipe of which one line is read, and a device that is always full."""
    command = f"exec {sys.executable} -c '{PROGRAM}'"
    for redirected in ("", "> /dev/full 2>&1"):
        process = subprocess.Popen(
            ["sh", "-c", f"{command} {redirected}"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.readline()
        process.stdout.close()
        problems = process.stderr.read().decode()
        process.stderr.close()
        assert process.wait() == 7, problems
        assert problems in ("note: on stderr\n", "")
