"""What a report is about, and the files that it is written to."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from mrbt_mesh.cli.framework.terminal import reason, write_file
from mrbt_mesh.cli.views.report_html import report_html
from mrbt_mesh.cli.views.report_markdown import report_markdown
from mrbt_mesh.errors import InputError
from mrbt_mesh.recording.folder import observer_files, robot_files
from mrbt_mesh.recording.reader import read_recording
from mrbt_mesh.runtime.run_dir import SUMMARY_FILE
from mrbt_mesh.views.report.model import CampaignReport, RunReport, RunsReport
from mrbt_mesh.views.report.recorded import report_recording
from mrbt_mesh.views.report.told import (
    drill_expectations,
    report_campaign,
    report_drill,
    report_summary,
)

TELLERS = "`mrbt sim`, `up`, `drill` or `chaos`"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
ENDINGS = (".html", ".md", ".pdf", ".png")
MOST_BYTES = 1 << 28
PICTURE_WIDTH, MOST_HEIGHT = 1440, 16_000
BROWSER_TIMEOUT_S = 60


def read_report(paths: Iterable[Path]) -> RunsReport:
    """Recordings, run directories, and what commands told with --json; raises InputError."""
    runs: list[RunReport] = []
    campaigns: list[CampaignReport] = []
    for path in paths:
        if path.is_dir():
            runs.append(_run_dir(path))
        elif path.suffix == ".mcap":
            runs.append(report_recording(read_recording(path), path.stem))
        else:
            for each in _told(path):
                (campaigns if isinstance(each, CampaignReport) else runs).append(each)  # type: ignore[arg-type]
    return RunsReport(tuple(_named_apart(runs)), tuple(campaigns))


def _run_dir(path: Path) -> RunReport:
    summary = path / SUMMARY_FILE
    told = _object(summary) if summary.exists() else None
    title, file = path.resolve().name, _recording_of(path)
    if file is None and told is None:
        raise InputError(f"{path} holds neither recordings nor {SUMMARY_FILE}: it is no run's")
    with _refused(f"{summary}: is no summary of a run"):
        if file is not None:
            return report_recording(read_recording(file), title, told)
        return report_summary(told or {}, title)


def _recording_of(run_dir: Path) -> Path | None:
    """The recording to report on: that of whoever watched last, else of the robot that wrote last,
    which has seen most of the run.
    """
    files = observer_files(run_dir) or robot_files(run_dir)
    return max(files, key=lambda file: file.stat().st_mtime_ns, default=None)


@contextlib.contextmanager
def _refused(what: str) -> Iterator[None]:
    """Tell what is wrong with data that a command has not told so."""
    try:
        yield
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{what}: {error!r}") from None


def _object(path: Path) -> Mapping[str, Any]:
    try:
        if path.stat().st_size > MOST_BYTES:
            raise InputError(f"{path}: more than {MOST_BYTES >> 20} MiB of JSON")
        data = json.loads(path.read_text(encoding="utf-8"))
        # Neither numbers that are none, nor texts that are no Unicode.
        json.dumps(data, ensure_ascii=False, allow_nan=False).encode()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {reason(error)}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: is neither a recording (.mcap) nor JSON: {error}") from None
    if not isinstance(data, dict):
        raise InputError(f"{path}: is not what {TELLERS} tell with --json")
    return data


def _told(path: Path) -> Sequence[RunReport | CampaignReport]:
    data = _object(path)
    with _refused(f"{path}: is not what {TELLERS} tell with --json"):
        if "runs" in data and "green" in data:
            return [_drill(each) for each in data["runs"]]
        if "checks" in data and "seeds" in data:
            return [report_campaign(data, path.stem)]
        return [report_summary(data, path.stem)]


def _drill(told: Mapping[str, Any]) -> RunReport:
    """A drill's run, by its recording where that is still there."""
    title = f"{told['drill']} ({told['transport']})"
    file = _recording_of(Path(told["run_dir"])) if told["run_dir"] else None
    if file is None:
        return report_drill(told, title)
    # A drill counts its times from its own begin: only how long things took is of use.
    lengths = [{**each, "at_s": None} for each in told["takeovers"]]
    found = report_recording(read_recording(file), title, {"takeovers": lengths})
    verdict, expected = str(told["verdict"]), drill_expectations(told)
    return replace(found, verdict=verdict, expectations=expected)


def _named_apart(runs: list[RunReport]) -> Iterator[RunReport]:
    seen: dict[str, int] = {}
    for run in runs:
        seen[run.title] = number = seen.get(run.title, 0) + 1
        yield run if number == 1 else replace(run, title=f"{run.title} ({number})")


def check_output(path: Path) -> None:
    """Raise InputError, before long work begins, for what cannot be written."""
    if path.suffix not in ENDINGS:
        raise InputError(f"-o {path}: the ending says what is written: {', '.join(ENDINGS)}")
    if path.suffix in (".pdf", ".png"):
        _browser()


def write_report(report: RunsReport, path: Path) -> None:
    """Write it as its ending says; raises InputError."""
    if path.suffix == ".md":
        write_file(path, report_markdown(report))
    elif path.suffix == ".html":
        write_file(path, report_html(report))
    else:
        _print(report_html(report), path)


def _browser() -> str:
    found = next((at for name in BROWSERS if (at := shutil.which(name))), None)
    if found is None:
        raise InputError(
            "PDF and PNG are made by Chromium, which is not installed (Debian: apt install "
            "chromium); -o report.html can be printed by any browser"
        )
    return found


def _print(page: str, path: Path) -> None:
    """Have a headless browser print the page."""
    with tempfile.TemporaryDirectory(prefix="mrbt-report-") as folder:
        source, target = Path(folder) / "report.html", Path(folder) / f"report{path.suffix}"
        source.write_text(page, encoding="utf-8")
        common = [_browser(), "--headless", "--disable-gpu", "--hide-scrollbars"]
        common += [f"--user-data-dir={folder}/profile", "--disable-dev-shm-usage"]
        if os.geteuid() == 0:
            common.append("--no-sandbox")  # Chromium has no sandbox for root.
        if path.suffix == ".pdf":
            _run([*common, "--no-pdf-header-footer", f"--print-to-pdf={target}", source.as_uri()])
        else:
            # A window as high as the page: what the page itself says of its height.
            asking = Path(folder) / "asking.html"
            asking.write_text(page.replace("</body>", _MEASURE + "</body>"), encoding="utf-8")
            window = f"--window-size={PICTURE_WIDTH},900"
            told = _run([*common, window, "--dump-dom", asking.as_uri()])
            height = min(MOST_HEIGHT, int(told.partition(_MARK)[2].partition('"')[0]))
            window = f"--window-size={PICTURE_WIDTH},{height}"
            _run([*common, window, f"--screenshot={target}", source.as_uri()])
        try:
            shutil.copyfile(target, path)
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {reason(error)}") from None


_MARK = '<body data-height="'
_MEASURE = "<script>document.body.dataset.height=document.documentElement.scrollHeight</script>"


def _run(command: list[str]) -> str:
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=BROWSER_TIMEOUT_S, check=True
        )
    except (OSError, subprocess.SubprocessError) as error:
        raise InputError(f"{command[0]} could not make the file: {error}") from None
    return done.stdout
