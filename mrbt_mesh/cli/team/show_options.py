"""The options that say how a run is shown, and for how long."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from mrbt_mesh.cli.framework.declare import option
from mrbt_mesh.cli.options import JsonOption

HeadlessOption = Annotated[bool, option("Lines as things happen, no live view.")]


@dataclass(frozen=True)
class ShowOptions:
    """A live view, lines as things happen, or one JSON object at the end."""

    headless: HeadlessOption = False
    as_json: JsonOption = False
    timeout: Annotated[
        float | None,
        option("End the run after this many seconds.", "SECONDS", least=0),
    ] = None
