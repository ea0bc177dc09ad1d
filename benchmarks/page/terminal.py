"""What a command draws in a terminal of a given size, as a picture: tmux draws, Chromium prints."""

from __future__ import annotations

import io
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path

from playwright.sync_api import Browser
from rich.console import Console
from rich.text import Text

from benchmarks.run import until
from tests.support.paths import ROOT

# Until the first screen is drawn, and then until all has come that robots say.
WAIT_S, SETTLE_S = 60.0, 5.0
_PAGE = """<!doctype html><meta charset="utf-8"><style>{stylesheet}
body {{ margin: 0; background: #111; color: #ddd; display: inline-block; }}
pre {{ margin: 8px; font: 14px/1.35 "DejaVu Sans Mono", monospace; }}</style><pre>{code}</pre>"""


def capture(
    folder: Path, size: tuple[int, int], environment: Mapping[str, str], *arguments: str
) -> str:
    """The screen of `mrbt ...` once it has settled, with its colours as control sequences."""
    tmux = ["tmux", "-u", "-f", "/dev/null", "-S", str(folder / "tmux")]
    columns, lines = map(str, size)
    shell = ["env", *(f"{name}={value}" for name, value in environment.items())]
    shell += ["COLORTERM=truecolor", sys.executable, "-m", "mrbt_mesh", *arguments]
    start = [*tmux, "new-session", "-d", "-x", columns, "-y", lines, *shell]
    subprocess.run(start, check=True, cwd=ROOT)
    shown = [*tmux, "capture-pane", "-p", "-e"]

    def drawn() -> str:
        return subprocess.run(shown, check=True, capture_output=True, text=True).stdout

    try:
        if not until(lambda: "robots" in drawn(), WAIT_S):
            raise TimeoutError(f"nothing drawn by {arguments}: {drawn()}")
        time.sleep(SETTLE_S)
        return drawn()
    finally:
        subprocess.run([*tmux, "kill-server"], check=False)


def write_picture(browser: Browser, screen: str, columns: int, file: Path) -> None:
    """A captured screen as a PNG."""
    console = Console(
        file=io.StringIO(),
        record=True,
        width=columns,
        force_terminal=True,
        color_system="truecolor",
    )
    console.print(Text.from_ansi(screen), soft_wrap=True, end="")
    page = browser.new_page()
    page.set_content(console.export_html(code_format=_PAGE, inline_styles=False))
    page.locator("body").screenshot(path=file)
    page.close()
