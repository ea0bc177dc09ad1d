"""What others wrote is as they published it, with its licence, and the page loads nothing else."""

from __future__ import annotations

import hashlib
import json
import re

from mrbt_mesh.views.web.app import STATIC

VENDOR = STATIC / "vendor"


def sums() -> dict[str, str]:
    rows = (VENDOR / "SHA256SUMS").read_text().splitlines()
    return {name: digest for digest, name in (row.split() for row in rows)}


def test_every_file_is_listed_and_unchanged() -> None:
    there = {path.name for path in VENDOR.iterdir()} - {"SHA256SUMS"}
    assert there == set(sums())
    for name, digest in sums().items():
        assert hashlib.sha256((VENDOR / name).read_bytes()).hexdigest() == digest, name


def test_the_licence_names_every_module() -> None:
    licence = (VENDOR / "LICENSE").read_text()
    for path in VENDOR.glob("*.mjs"):
        assert path.name.partition(".")[0] in licence
    assert "Mike Bostock" in licence


def test_every_import_has_a_file() -> None:
    """Bare names by the import map, others by their paths: nothing comes from elsewhere."""
    page = (STATIC / "index.html").read_text()
    found = re.search(r'<script type="importmap">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    imports = json.loads(found[1])["imports"]
    assert {path.removeprefix("./static/vendor/") for path in imports.values()} == {
        path.name for path in VENDOR.glob("*.mjs")
    }
    for module in [*STATIC.glob("*.mjs"), *VENDOR.glob("*.mjs")]:
        for name in re.findall(r'(?:from|import)\s*["\']([^"\']+)["\']', module.read_text()):
            assert name in imports or (module.parent / name).is_file(), f"{module.name}: {name}"


def test_nothing_is_loaded_from_the_network() -> None:
    for path in [*STATIC.glob("*.mjs"), *STATIC.glob("*.css"), STATIC / "index.html"]:
        without_names = path.read_text().replace("http://www.w3.org/2000/svg", "")
        assert not re.search(r"https?://", without_names), path.name
