"""Runs the bridge with `python FOLDER`, as a package of its own without mrbt_mesh."""

import importlib
import importlib.util
import sys
from pathlib import Path

NAME = "mrbt_ros2_bridge"


def _as_package() -> None:
    folder = Path(__file__).resolve().parent
    # Python has added the folder itself; its modules must be found only in the package.
    sys.path[:] = [entry for entry in sys.path if Path(entry or ".").resolve() != folder]
    places = [str(folder)]
    spec = importlib.util.spec_from_file_location(
        NAME, folder / "__init__.py", submodule_search_locations=places
    )
    assert spec is not None
    assert spec.loader is not None
    sys.modules[NAME] = package = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(package)


_as_package()
sys.exit(importlib.import_module(f"{NAME}.main").main(sys.argv[1:]))
