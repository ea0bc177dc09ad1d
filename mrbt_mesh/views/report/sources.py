"""Reads the sources of a report: a recording, or a run directory."""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

from mrbt_mesh.errors import InputError
from mrbt_mesh.recording.folder import first_parts, observer_files, robot_files
from mrbt_mesh.recording.reader import EmptyRecordingError, Recording, open_recording
from mrbt_mesh.runtime.command_log import read_regular
from mrbt_mesh.runtime.run_dir import SIGNATURE_FILE, SUMMARY_FILE
from mrbt_mesh.views.replay.findings import GapKind, Verification
from mrbt_mesh.views.report.abrupt_ends import with_abrupt_ends
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
    """Yield the run, or one part for each of its observers, in order, if it was continued."""
    summary = path / SUMMARY_FILE
    data = _json_object(summary) if summary.exists() else None
    title, files = path.resolve().name, _recordings_of(path)
    with _refusing(f"{summary}: is not a summary of a run"):
        if files:
            opened = map(open_recording, sorted(files, key=lambda file: len(file.name)))
            recordings = sorted(opened, key=_began_unix_us)
            proof = verify(path)
            is_told = data is not None and _is_as_signed(proof)
            told = report_summary(data, title) if data is not None and is_told else None
            begins = [_began_unix_us(each) / 1e6 for each in recordings]
            for at, recording in enumerate(recordings):
                more = f", {recording.name}" if len(recordings) > 1 else ""
                is_last = at == len(recordings) - 1
                found = report_recording(
                    recording, f"{title}{more}", told if is_last else None, is_continued=at > 0
                )
                if is_last and told is None:
                    found = with_abrupt_ends(found, recording, _robots_last(path))
                began_unix_s = found.identity.began_unix_s if found.identity is not None else None
                from_s = begins[at] if at else -math.inf
                until_s = [*begins, math.inf][at + 1]
                commands = tuple(_commands(proof, began_unix_s, from_s, until_s))
                yield replace(found, proof=_proof(proof), commands=commands)
            return
        if data is not None:
            yield report_summary(data, title)
            return
    raise InputError(
        f"{path} holds neither recordings nor {SUMMARY_FILE}: it is not a run directory"
    )


def _is_as_signed(found: Verification) -> bool:
    """Return whether nothing speaks against the summary; without keys nothing proves it either."""
    files = {each.file for each in found.findings}
    files |= {each.of for each in found.gaps if each.kind is GapKind.SUMMARY}
    return files.isdisjoint((SUMMARY_FILE, SIGNATURE_FILE))


def _robots_last(run_dir: Path) -> list[Recording]:
    """Return the last recording of each robot."""
    found: dict[str, Recording] = {}
    for path in first_parts(robot_files(run_dir)):
        with contextlib.suppress(EmptyRecordingError):
            each = open_recording(path)
            robot = each.metadata.robot
            if robot not in found or _began_unix_us(found[robot]) < _began_unix_us(each):
                found[robot] = each
    return list(found.values())


def _proof(found: Verification) -> Proof:
    findings, gaps = tuple(map(str, found.findings)), tuple(map(str, found.gaps))
    return Proof(found.files, found.team_key, dict(found.counts), findings, gaps)


def _began_unix_us(recording: Recording) -> int:
    return recording.metadata.epoch_ns // 1_000 + recording.begin_us


def _commands(
    found: Verification, began_unix_s: float | None, from_s: float, until_s: float
) -> Iterator[ReportedCommand]:
    """Yield the commands of a run between two times; a line that was cut off is omitted."""
    for each in found.commands:
        if each.unix_s is not None and from_s <= each.unix_s < until_s:
            at_s = None if began_unix_s is None else each.unix_s - began_unix_s
            yield ReportedCommand(at_s, each.by, each.command, each.signer)


def _recordings_of(run_dir: Path) -> list[Path]:
    """Return the observers' recordings, else a robot's newest one, which has most of the run."""
    if observed := first_parts(observer_files(run_dir)):
        return observed
    files = robot_files(run_dir)
    return first_parts(sorted(files, key=lambda file: file.stat().st_mtime_ns)[-1:])


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
