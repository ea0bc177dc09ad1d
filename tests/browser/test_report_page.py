"""A report in a real browser: readable for everybody, light and dark, on a phone."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from mrbt_mesh.sim import Kill, Lose
from tests.support.browser import PHONE, WIDE, accessibility_violations, opened, picture
from tests.support.command import mrbt
from tests.support.recorded import record_example

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = [
    pytest.mark.browser,
    # Chromium's driver opens an event loop of its own.
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]

FAULTS = [(12_500_000, Kill("A1")), (15_000_000, Lose("B2", "replace_hw"))]


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of a run with both kinds of faults, in a run directory with its summary."""
    folder = tmp_path_factory.mktemp("reported")
    result = record_example(folder, "vehicle_repair", 7, FAULTS)
    (folder / "summary.json").write_text(json.dumps(result.summary))
    page = folder / "report.html"
    assert mrbt("recording", "report", str(folder), "-o", str(page))[0] == 0
    return page


@pytest.mark.slow
def test_everybody_can_read_it(report: Path, browser: Browser) -> None:
    for size in (WIDE, PHONE):
        for scheme in ("light", "dark"):
            page, problems = opened(browser, report.as_uri(), size, scheme, ready="main")
            assert "Agreement" in page.inner_text("main")
            picture(page, f"report-{'wide' if size == WIDE else 'phone'}-{scheme}")
            assert accessibility_violations(page) == []
            assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
            assert problems == []
            page.close()
