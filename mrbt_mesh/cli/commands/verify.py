"""`mrbt verify`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from mrbt_mesh.cli.framework.declare import argument, option
from mrbt_mesh.cli.options import JsonOption


def verify(
    paths: Annotated[
        tuple[Path, ...],
        argument("FILE.mcap|RUN_DIR", "Recordings, or run directories. Default: the last run's."),
    ] = (),
    keys: Annotated[
        Path | None,
        option("Folder with the team's manifest. Default: that of the run directory.", "DIR"),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Prove from the recordings of a run what its robots did, and find what was falsified.

    Every plan is made again from the recorded facts, by the plain definitions; each robot must
    have done what its plans said; every takeover must have a cause; what several robots have
    recorded must be the same; and where the run had keys, every fact must be signed.

    Exit status: 0 all is proved, 1 something is not, 2 bad input.

    Example: mrbt verify; mrbt verify RUN_DIR; mrbt verify A1.mcap B1.mcap --json
    """
    from mrbt_mesh.cli.framework.exits import FAILURE, SUCCESS
    from mrbt_mesh.cli.framework.terminal import console, print_json
    from mrbt_mesh.cli.recordings.files import chosen, signature_check
    from mrbt_mesh.cli.views.verdict_view import render_verdict
    from mrbt_mesh.views.replay.verify import verify as verify_recordings

    recordings, folder = chosen(paths)
    verdict = verify_recordings(recordings, signature_check(keys or folder))
    if as_json:
        print_json(verdict.to_json())
    else:
        console.print(render_verdict(verdict))
    raise SystemExit(SUCCESS if verdict.is_good else FAILURE)
