"""How plug-ins are found, and what is said where one is missing."""

from __future__ import annotations

import importlib.metadata
import subprocess
import sys
from importlib.metadata import EntryPoint

import pytest

from mrbt_mesh import plugins
from mrbt_mesh.errors import InputError, require
from mrbt_mesh.plugins import Group


@pytest.fixture
def group(monkeypatch: pytest.MonkeyPatch) -> Group[object]:
    """One plug-in that is there; the modules of two others are not."""
    points = {
        "path": "os.path:join",
        "without_its_module": "mrbt_mesh.no_such_module:x",
        "without_its_package": "no_such_package.module:x",
    }
    monkeypatch.setattr(
        importlib.metadata,
        "entry_points",
        lambda group: [EntryPoint(name, value, group) for name, value in points.items()],
    )
    plugins._installed.cache_clear()
    return Group("mrbt_mesh.test", "view")


@pytest.fixture(autouse=True)
def _forget() -> object:
    yield
    plugins._installed.cache_clear()


def test_a_plugin_is_found_by_its_name(group: Group[object]) -> None:
    import os.path

    assert group.load("path") is os.path.join


@pytest.mark.parametrize("name", ["without_its_module", "without_its_package", "unknown"])
def test_an_entry_point_whose_module_is_not_there_is_not_installed(
    group: Group[object], name: str
) -> None:
    assert group.names() == ["path"]
    with pytest.raises(InputError, match=f"view '{name}' is not installed; installed: path"):
        group.load(name)


def test_a_missing_extra_is_said_with_the_remedy() -> None:
    require("the page", "web", "os.path")
    with pytest.raises(InputError, match=r"the page needs the extra 'web': pip install 'mrbt-mesh"):
        require("the page", "web", "os", "no_such_package.module")


def test_the_views_of_this_package_are_installed_and_cheap_to_import() -> None:
    """No extra is needed for their help."""
    heavy = ("starlette", "uvicorn", "textual", "zmq", "foxglove")
    code = (
        "import sys; from mrbt_mesh.plugins import *\n"
        "for name in VIEWS.names(): print(VIEWS.load(name).summary)\n"
        f"print([name for name in {heavy} if name in sys.modules])"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    *summaries, loaded = said.stdout.splitlines()
    assert len(summaries) >= 2
    assert loaded == "[]"
