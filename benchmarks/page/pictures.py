"""Pictures of all views in all situations, to be looked at."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser

from benchmarks.page.chromium import chromium
from benchmarks.page.situations import SITUATIONS, Scene, situation
from benchmarks.page.terminal import capture, write_picture

WAIT_MS = 60_000
SCREENS = ((1440, 900), (1366, 768), (390, 844))
TERMINALS = ((80, 24), (120, 40))
_READY = '#headline p:not(:has-text("connecting")):not(:has-text("waiting"))'


def make(folder: Path, names: Collection[str]) -> None:
    """Write the pictures of these situations, or of all."""
    folder.mkdir(parents=True, exist_ok=True)
    with chromium() as browser:
        for name in names or SITUATIONS:
            with situation(name) as scene:
                for width, height in SCREENS:
                    for scheme in ("light", "dark"):
                        file = folder / f"{name}-{width}x{height}-{scheme}.png"
                        _page(browser, scene, (width, height), scheme, file)
                for size in TERMINALS:
                    file = folder / f"{name}-terminal-{size[0]}x{size[1]}.png"
                    _terminal(browser, scene, name, size, file)


def _page(browser: Browser, scene: Scene, size: tuple[int, int], scheme: Any, file: Path) -> None:
    context = browser.new_context(
        viewport={"width": size[0], "height": size[1]}, color_scheme=scheme
    )
    page = context.new_page()
    page.set_default_timeout(WAIT_MS)
    page.goto(scene.url)
    page.wait_for_selector(_READY)
    # Until the drawer has the newest fault, and the run's past has come.
    page.wait_for_timeout(1_500)
    page.screenshot(path=file)
    if size[0] < 600:
        page.screenshot(path=file.with_stem(f"{file.stem}-whole"), full_page=True)
    context.close()


def _terminal(browser: Browser, scene: Scene, name: str, size: tuple[int, int], file: Path) -> None:
    team = scene.team
    how = ["--top"] if name == "ended" else []
    command = ["watch", *how, "--run-dir", str(team.run_dir)]
    kept = {key: team.environment[key] for key in ("MRBT_STATE_DIR", "MRBT_HOLD")}
    screen = capture(team.folder, size, kept, *command)
    file.with_suffix(".txt").write_text(screen)
    write_picture(browser, screen, size[0], file)
