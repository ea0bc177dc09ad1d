"""The names of the package are offered before they are loaded."""

from __future__ import annotations

import mrbt_mesh


def test_dir_shows_all_names_and_each_can_be_loaded() -> None:
    assert dir(mrbt_mesh) == sorted(mrbt_mesh.__all__)
    assert all(getattr(mrbt_mesh, name) is not None for name in dir(mrbt_mesh))
