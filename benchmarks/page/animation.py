"""The README's animation: a robot is killed from its menu, and another one ends its work."""

from __future__ import annotations

import io
import tempfile
import time
from collections import Counter
from itertools import pairwise
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import Page

from benchmarks.page.chromium import chromium
from benchmarks.page.situations import address
from tests.support.team import REPAIR, Team

SIZE = 880, 760
WAIT_MS, FRAME_S, LAST_S = 60_000, 0.2, 4.0
COLOURS = 128
# Times of the run: so fast do the robots work, and so long is the menu and the drawer seen.
SPEED, MENU_S, DRAWER_S = 1.3, 0.8, 3.0
_WORKS = '.card[data-group="work"]:has-text("do_diagnosis")'
_OVER = '#headline p:has-text("success after")'


class _Film:
    """Pictures of a page with the times at which they were taken."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._taken: list[tuple[float, Image.Image]] = []

    def until(self, selector: str, at_least_s: float = 0.0) -> None:
        """Take pictures until this is there, and for some seconds at least."""
        began_s = time.monotonic()
        while time.monotonic() < began_s + at_least_s or not self._page.query_selector(selector):
            now_s = time.monotonic()
            if now_s > began_s + WAIT_MS / 1e3:
                raise TimeoutError(f"never seen: {selector}")
            shown = Image.open(io.BytesIO(self._page.screenshot())).convert("RGB")
            self._taken.append((now_s, shown))
            self._page.wait_for_timeout(max(0.0, now_s + FRAME_S - time.monotonic()) * 1e3)

    def write(self, file: Path) -> None:
        """An animation with one palette; what does not change costs nothing."""
        times = [at_s for at_s, _ in self._taken]
        times.append(times[-1] + LAST_S)
        # The colours of the page as they are; those of the edges of letters become the nearest.
        counts: Counter[Any] = Counter()
        for _, shown in self._taken:
            counts.update({c: n for n, c in shown.getcolors(SIZE[0] * SIZE[1]) or []})
        palette = Image.new("P", (1, 1))
        palette.putpalette([part for colour, _ in counts.most_common(COLOURS) for part in colour])
        frames = [
            shown.quantize(palette=palette, dither=Image.Dither.NONE) for _, shown in self._taken
        ]
        long_ms = [round((b - a) * 1e3) for a, b in pairwise(times)]
        frames[0].save(
            file, save_all=True, append_images=frames[1:], duration=long_ms, loop=0, optimize=True
        )


def make(file: Path) -> None:
    """Film a run from its begin to its end."""
    folder = tempfile.TemporaryDirectory(prefix="mrbt-film-")
    with folder, Team(Path(folder.name)) as team, chromium() as browser:
        context = browser.new_context(
            viewport={"width": SIZE[0], "height": SIZE[1]}, bypass_csp=True
        )
        page = context.new_page()
        page.set_default_timeout(WAIT_MS)
        team.up(REPAIR, "--web", "--control", speed=SPEED)
        team.wait_for_line("web: ")
        page.goto(address(team.lines()))
        # The folder of this run says nothing to readers.
        page.add_style_tag(content="#after { display: none !important; }")
        page.wait_for_selector(".card")
        film = _Film(page)
        film.until(_WORKS)
        film.until(_WORKS, 0.6)
        robot = page.inner_text(f"{_WORKS} .name")
        # A click of the mouse would scroll.
        page.eval_on_selector(
            f'button[aria-label="Commands to {robot}"]', "button => button.click()"
        )
        film.until("#menu", MENU_S)
        page.click(f'#menu button[aria-label="Kill {robot}"]')
        page.mouse.move(0, 0)
        film.until(f'#takeovers button:has-text("{robot} died")', DRAWER_S)
        page.eval_on_selector("#why-close", "button => button.click()")
        film.until(_OVER)
        film.until(_OVER, 1.0)
        film.write(file)
