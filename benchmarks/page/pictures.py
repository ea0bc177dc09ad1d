"""The README's pictures of the page: a robot has just been killed from its menu."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any, Literal

from benchmarks.page.chromium import chromium

WAIT_MS = 60_000
SCHEMES: tuple[Literal["light", "dark"], ...] = ("light", "dark")
_TAKEN_OVER = '#takeovers button:has-text("taken over"):not(:has-text("not taken over"))'
_MISSION = "examples/vehicle_repair/mission.yaml"
# A part is being diagnosed by a robot whose work another one, now free, can take over.
_MOMENT = """() => {
  const said = [...document.querySelectorAll(".card")].map((card) => card.innerText);
  const works = (text) => /^B1[^]*do_diagnosis\\(/.test(text);
  const isFree = (text) => /^A[12][^]*(as many robots|no request)/.test(text);
  return said.some(works) && said.some(isFree);
}"""


def make(folder: Path) -> None:
    """Write `page-light.png` and `page-dark.png`."""
    folder.mkdir(parents=True, exist_ok=True)
    team = subprocess.Popen(
        [sys.executable, "-m", "mrbt_mesh", "up", _MISSION, "--headless", "--web", "--control"],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert team.stdout is not None
    lines = iter(team.stdout)
    found = next(filter(None, (re.search(r"web: (\S+)", line) for line in lines)))
    with chromium() as browser:
        pages: dict[str, Any] = {}
        for scheme in SCHEMES:
            context: Any = browser.new_context(
                viewport={"width": 1440, "height": 900},
                color_scheme=scheme,
            )
            pages[scheme] = context.new_page()
            pages[scheme].set_default_timeout(WAIT_MS)
            pages[scheme].goto(found[1])
        first = pages["light"]
        first.wait_for_function(_MOMENT)
        first.click('button[aria-label="Orders to B1"]')
        first.click('button[aria-label="Kill B1"]')
        for page in pages.values():
            page.wait_for_selector(_TAKEN_OVER)
            page.wait_for_selector("#why-body table")
        first.wait_for_selector("#toast", state="hidden")
        # Robots keep their places while the mouse points at them.
        first.mouse.move(0, 0)
        for name, page in pages.items():
            page.screenshot(path=folder / f"page-{name}.png")
    team.send_signal(signal.SIGINT)
    team.communicate()
