"""`mrbt plan` of an example in a process of its own, traced from its first import on.

    python -m benchmarks.walk.command plan examples/vehicle_repair/mission.yaml

Writes what was counted to standard output, as JSON, in place of what the command says.
"""

from __future__ import annotations

import contextlib
import io
import json
import sys

from benchmarks.walk.trace import begin, end


def main() -> None:
    said = io.StringIO()
    trace = begin()
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        from mrbt_mesh.cli.main import main as mrbt

        mrbt()
    end()
    if not said.getvalue():
        sys.exit("the command said nothing")
    modules = sorted(name for name in sys.modules if name.split(".")[0] == "mrbt_mesh")
    third = {name.partition(".")[0] for name in sys.modules} & {"zenoh", "ortools", "numpy", "rich"}
    found = {
        "product": trace.figures(),
        "core": trace.within("core/").figures(),
        "files": dict(trace.files()),
        "modules_imported": modules,
        "libraries_imported": sorted(third),
    }
    json.dump(found, sys.stdout)


if __name__ == "__main__":
    main()
