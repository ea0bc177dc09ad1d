"""Reads the sources of a report: a recording, or a run directory."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

from mrbt_mesh.errors import InputError
from mrbt_mesh.recording.folder import first_parts, observer_files, robot_files
from mrbt_mesh.recording.reader import EmptyRecordingError, Recording, open_recording
from mrbt_mesh.runtime.command_log import NotedCommand, read_regular
from mrbt_mesh.runtime.run_dir import SIGNATURE_FILE, SUMMARY_FILE
from mrbt_mesh.views.replay.findings import GapKind, Verification
from mrbt_mesh.views.report.launches import (
    commands_of,
    launches_of,
    missing_launches,
    with_ends,
)
from mrbt_mesh.views.report.model import (
    Proof,
    ReportedCommand,
    RunParts,
    RunReport,
)
from mrbt_mesh.views.report.recorded import report_recording
from mrbt_mesh.views.report.summaries import report_summary

Verify: TypeAlias = Callable[[Path], Verification]


def read_report(path: Path, verify: Verify) -> RunParts:
    """Return the run of a recording or run directory, whose recordings `verify` verifies.

    Raises InputError.
    """
    if path.is_dir():
        return RunParts(tuple(_run_dir(path, verify)))
    found = report_recording(open_recording(path), path.stem)
    return RunParts((replace(found, proof=_proof(verify(path))),))


def _run_dir(path: Path, verify: Verify) -> Iterator[RunReport]:
    """Yield the run, or one part for each of its launches, in order, if it was continued."""
    summary = path / SUMMARY_FILE
    data = _json_object(summary) if summary.exists() else None
    title = path.resolve().name
    with _refusing(f"{summary}: is not a summary of a run"):
        if files := first_parts([*robot_files(path), *observer_files(path)]):
            proof = verify(path)
            told = None
            if data is not None and _is_as_signed(proof):
                told = report_summary(data, title)
            yield from report_launches(_opened(files), title, told, proof)
            return
        if data is not None:
            yield report_summary(data, title)
            return
    raise InputError(
        f"{path} holds neither recordings nor {SUMMARY_FILE}: it is not a run directory"
    )


def report_launches(
    recordings: Iterable[Recording], title: str, told: RunReport | None, proof: Verification
) -> Iterator[RunReport]:
    """Yield the launches of a run in order; `told`: its summary, which is of the last one.

    Raises RecordingError for a damaged recording.
    """
    launches = launches_of(recordings)
    commands = commands_of(launches, proof.commands)
    missing = missing_launches(launches, proof.commands)
    parts = [
        (launch, given, each)
        for launch, given in zip(launches, commands, strict=True)
        for each in launch.shown
    ]
    for at, (launch, given, recording) in enumerate(parts):
        more = f", {recording.name}" if len(parts) > 1 else ""
        tells = told if at == len(parts) - 1 else None
        died_us = launch.died_us(proof, recording)
        found = report_recording(recording, title + more, tells, died_us, is_continued=at > 0)
        found = with_ends(found, launch, recording, proof, given, is_told=tells is not None)
        if missing and not at:
            found = replace(found, notes=(*found.notes, missing))
        began_unix_s = found.identity.began_unix_s if found.identity is not None else None
        reported = tuple(_command(each, began_unix_s) for each in given)
        yield replace(found, proof=_proof(proof), commands=reported)


def _opened(files: Iterable[Path]) -> list[Recording]:
    """Return the recordings of files, except of those that hold nothing yet."""
    found: list[Recording] = []
    empty: list[EmptyRecordingError] = []
    for path in files:
        try:
            found.append(open_recording(path))
        except EmptyRecordingError as error:
            empty.append(error)
    if not found:
        raise empty[0]
    return found


def _is_as_signed(found: Verification) -> bool:
    """Return whether nothing speaks against the summary; without keys nothing proves it either."""
    files = {each.file for each in found.findings}
    files |= {each.of for each in found.gaps if each.kind is GapKind.SUMMARY}
    return files.isdisjoint((SUMMARY_FILE, SIGNATURE_FILE))


def _proof(found: Verification) -> Proof:
    findings, gaps = tuple(map(str, found.findings)), tuple(map(str, found.gaps))
    return Proof(found.files, found.team_key, dict(found.counts), findings, gaps)


def _command(noted: NotedCommand, began_unix_s: float | None) -> ReportedCommand:
    known = None not in (noted.unix_s, began_unix_s)
    at_s = (noted.unix_s or 0.0) - (began_unix_s or 0.0) if known else None
    return ReportedCommand(at_s, noted.by, noted.command, noted.signer)


@contextlib.contextmanager
def _refusing(what: str) -> Iterator[None]:
    """Raise InputError for incomplete data."""
    try:
        yield
    except InputError:
        raise
    except KeyError as error:
        raise InputError(f"{what}: it has no {error.args[0]!r}") from None
    except (TypeError, ValueError, AttributeError):
        raise InputError(f"{what}: a value is of another kind") from None


def _json_object(path: Path) -> Mapping[str, Any]:
    try:
        data = json.loads(read_regular(path).decode("utf-8"))
        # Refuse numbers that are not finite, and texts that are not Unicode.
        json.dumps(data, ensure_ascii=False, allow_nan=False).encode()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (ValueError, RecursionError):
        raise InputError(
            f"{path}: is not JSON, or has numbers or texts that JSON has not"
        ) from None
    if not isinstance(data, dict):
        raise InputError(f"{path}: is not a summary of a run")
    return data
