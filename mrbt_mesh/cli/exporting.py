"""Files for other programs, written while a team is watched or simulated."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, BinaryIO, TypeAlias

from mrbt_mesh.cli.framework.declare import option

if TYPE_CHECKING:
    from mrbt_mesh.core.mission.mission import Mission
    from mrbt_mesh.core.observer.observer import Observer

PANEL = "Files for other programs"
# Is shown the team whenever something may have changed, with the time on the observer's clock.
LookOn: TypeAlias = "Callable[[Observer, int], None]"


@dataclass(frozen=True)
class ExportOptions:
    """What is written of the team's tree T_G."""

    btlog: Annotated[
        Path | None,
        option("Write every change of its statuses, for Groot2.", "FILE.btlog", panel=PANEL),
    ] = None
    py_trees_js: Annotated[
        Path | None,
        option("Write snapshots for py_trees_js, JSON lines.", "FILE.jsonl", panel=PANEL),
    ] = None

    def outputs(self) -> dict[str, Path | None]:
        """The files by their options."""
        return {"--btlog": self.btlog, "--py-trees-js": self.py_trees_js}

    def check(self) -> None:
        """Raise InputError, before long work begins, for files that cannot be written."""
        from mrbt_mesh.cli.framework.terminal import check_outputs
        from mrbt_mesh.errors import InputError

        check_outputs(None, self.outputs())
        if self.btlog is not None and self.btlog.suffix != ".btlog":
            raise InputError(f"--btlog {self.btlog}: Groot2 wants the ending .btlog")

    @contextmanager
    def writing(self, mission: Mission, began_us: int, began_unix_us: int) -> Iterator[LookOn]:
        """Open the files; yields what writes to them.

        `began_us`: the time on the observer's clock that is the Unix time `began_unix_us`. Raises
        InputError for files that cannot be written.
        """
        if self.btlog is None and self.py_trees_js is None:
            yield lambda observer, now_us: None
            return
        from mrbt_mesh.adapters.groot2.btlog import Btlog
        from mrbt_mesh.adapters.node_statuses import GlobalTree
        from mrbt_mesh.adapters.py_trees_js import Snapshots

        tree = GlobalTree(mission)
        with ExitStack() as stack:
            writers: list[LookOn] = []
            if self.btlog is not None:
                log, file = Btlog(tree), stack.enter_context(_file(self.btlog))
                _write(file, log.header(began_unix_us))
                writers.append(lambda o, at_us: _write(file, log.changes(o, at_us - began_us)))
            if self.py_trees_js is not None:
                lines = stack.enter_context(_file(self.py_trees_js))
                snapshots = Snapshots(tree)

                def write_snapshot(observer: Observer, now_us: int) -> None:
                    found = snapshots.changed(observer, now_us - began_us + began_unix_us)
                    if found is not None:
                        _write(lines, json.dumps(found).encode() + b"\n")

                writers.append(write_snapshot)

            def look_on(observer: Observer, now_us: int) -> None:
                for write in writers:
                    write(observer, now_us)

            yield look_on


@dataclass(frozen=True)
class RunFileOptions:
    """What is written of a simulated run."""

    events: Annotated[Path | None, option("Write what the robots did, as JSON lines.", "FILE")] = (
        None
    )
    log: Annotated[Path | None, option("Write every effect of every agent.", "FILE")] = None
    record: Annotated[
        Path | None, option("Record what robots know and do; docs/recording.md.", "DIR")
    ] = None
    export: ExportOptions = field(default_factory=ExportOptions)

    def check(self, mission: Path | None) -> None:
        """Raise InputError, before long work begins, for files that cannot be written."""
        from mrbt_mesh.cli.framework.terminal import check_new_folder, check_outputs

        own = {"--events": self.events, "--log": self.log}
        check_outputs(mission, own | self.export.outputs())
        check_new_folder("--record", self.record)
        self.export.check()


@contextmanager
def _file(path: Path) -> Iterator[BinaryIO]:
    from mrbt_mesh.cli.framework.terminal import reason
    from mrbt_mesh.errors import InputError

    try:
        # Unbuffered: what was written is there, however the process ends.
        file = path.open("wb", buffering=0)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {reason(error)}") from None
    with file:
        yield file


def _write(file: BinaryIO, data: bytes) -> None:
    """Write it; a disk that is full ends the file, and not the watching."""
    from mrbt_mesh.cli.framework.terminal import note, reason

    if file.closed or not data:
        return
    try:
        file.write(data)
    except OSError as error:
        note(f"{file.name}: ends here: {reason(error)}")
        file.close()
