"""Which nodes of a single robot's tree belong together, said by hand.

    units:
      serve_table: [TakeOrder, BringDrinks]     # these nodes together
      clean: [CleanUp]                          # each node that is called so
      first: ["Main/Sequence/Go:12"]            # by path, or by path and line

Nodes are named by their name, type or path. A unit has what is named, all below it, and all
between. What is not named is split as `--units auto` does it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

from pydantic import Field

from mrbt_mesh.formats.file_model import FileModel, Name, read_model
from mrbt_mesh.formats.yaml_source import read_mapping

_NodeText = Annotated[str, Field(min_length=1, max_length=1_000)]


class UnitsModel(FileModel):
    """Names of units, and the nodes in each."""

    units: dict[Name, Annotated[list[_NodeText], Field(min_length=1)]]


def load_units(path: Path) -> Mapping[str, list[str]]:
    """Read a file of units. Raises FileError with all problems that could be found."""
    data, report = read_mapping(path, "units are expected (units: {NAME: [NODE, ...]})")
    model = read_model(UnitsModel, data, report)
    report.raise_if_any()
    return model.units
