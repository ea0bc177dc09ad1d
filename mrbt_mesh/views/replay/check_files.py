"""Checks the other files of a run directory against the recordings or signatures."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mrbt_mesh.core.mission.compiled import compile_mission, mission_from_compiled
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.errors import InputError
from mrbt_mesh.recording.folder import FOLDER, SUFFIX, observer_files
from mrbt_mesh.recording.reader import Recording
from mrbt_mesh.runtime.command_log import (
    NotedCommand,
    heads,
    noted_commands,
    read_commands,
    read_regular,
)
from mrbt_mesh.runtime.member_keys import Manifest
from mrbt_mesh.runtime.run_dir import (
    COMMANDS_FILE,
    KEYS_FOLDER,
    MISSION_FILE,
    REVISION_FILE,
    SIGNATURE_FILE,
    SUMMARY_FILE,
)
from mrbt_mesh.runtime.summary_signature import parse_signature
from mrbt_mesh.views.replay.check_summary import (
    SummaryFile,
    check_summary,
    missing_summary,
    not_checked,
)
from mrbt_mesh.views.replay.findings import Gap, GapKind, RecordingFinding

_CHECKED = {
    *(FOLDER, KEYS_FOLDER, COMMANDS_FILE, MISSION_FILE, REVISION_FILE),
    *(SUMMARY_FILE, SIGNATURE_FILE),
}

NO_REVISION = (
    f"{REVISION_FILE} is missing: the revision in force was checked as the recordings have it"
)


@dataclass
class CheckedFiles:
    """Contradictions are differences from the recordings or from what was signed; gaps are what
    nobody has signed. `notes`: what was not checked. `commands`: all that were noted.
    """

    findings: list[RecordingFinding] = field(default_factory=list)
    gaps: list[Gap] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    commands: list[NotedCommand] = field(default_factory=list)


@dataclass(frozen=True)
class RunDirFiles:
    """The files of a run besides its recordings; None, or empty: there is none.

    `missions`: the texts of mission.json and revision.json by name. `others`: the names of files
    that nothing signs. `is_running`: the team is at work, so its end is not signed yet.
    """

    summary: SummaryFile | None = None
    commands: bytes | None = None
    missions: Mapping[str, str] = field(default_factory=dict)
    others: tuple[str, ...] = ()
    is_running: bool = False


def read_run_dir_files(run_dir: Path) -> RunDirFiles:
    """Read the files of a run directory. Raises InputError."""
    summary, signature = run_dir / SUMMARY_FILE, run_dir / SIGNATURE_FILE
    missions = [run_dir / name for name in (MISSION_FILE, REVISION_FILE)]
    known = {path.name for path in observer_files(run_dir)} | _CHECKED
    try:
        found = None
        if summary.is_file() or signature.is_file():
            text = _text(signature) if signature.is_file() else ""
            found = SummaryFile(read_regular(summary) if summary.is_file() else b"", text)
        return RunDirFiles(
            found,
            read_commands(run_dir / COMMANDS_FILE),
            {path.name: _text(path) for path in missions if path.is_file()},
            tuple(sorted(_others(run_dir, known))),
        )
    except OSError as error:
        file = error.filename or run_dir
        raise InputError(f"{file}: cannot be read: {error.strerror or error}") from None


def _text(path: Path) -> str:
    return read_regular(path).decode("utf-8", "replace")


def _others(run_dir: Path, known: Collection[str]) -> Iterator[str]:
    yield from (path.name for path in run_dir.iterdir() if path.name not in known)
    folder = run_dir / FOLDER
    if folder.is_dir():
        listed = (path.name for path in folder.iterdir() if path.suffix != SUFFIX)
        yield from (f"{FOLDER}/{name}" for name in listed)


def check_files(
    files: RunDirFiles,
    recordings: Sequence[Recording],
    manifest: Manifest | None,
    missions: Collection[str],
    revision: int,
) -> CheckedFiles:
    """Check the files of a run.

    `missions`: the digests of the missions that were in force. `revision`: the number of the last.
    """
    found = CheckedFiles()
    if files.summary is not None:
        found.findings, found.gaps = check_summary(files.summary, recordings, manifest)
        found.notes += not_checked(files.summary, recordings)
    elif manifest is not None:
        found.gaps += missing_summary(recordings)
    run, team_digest = recordings[0].metadata.run, recordings[0].metadata.team_digest
    numbers: dict[str, int] = {}
    for name, text in files.missions.items():
        try:
            mission = mission_from_compiled(text, name)
        except InputError:
            found.findings.append(_finding(name, "it is not a compiled mission"))
            continue
        numbers[name] = mission.number
        problems = _mission(mission, text, team_digest, missions)
        found.findings += [_finding(name, each) for each in problems]
    found.findings += [_finding(REVISION_FILE, each) for each in _order(numbers)]
    begun = numbers.get(MISSION_FILE)
    if begun is not None and begun < revision and REVISION_FILE not in files.missions:
        found.notes.append(NO_REVISION)
    found.commands += noted_commands(files.commands or b"", run, manifest)
    found.findings += [
        _finding(COMMANDS_FILE, f"line {each.number} {each.problem}")
        for each in found.commands
        if each.problem
    ]
    if manifest is not None:
        found.findings += [_finding(COMMANDS_FILE, each) for each in _end_of_commands(files, run)]
        found.gaps += _unsigned(found.commands)
    return found


def _finding(name: str, text: str) -> RecordingFinding:
    return RecordingFinding(name, 0, 0, text)


def _mission(
    mission: Mission, text: str, team_digest: str, missions: Collection[str]
) -> Iterator[str]:
    if mission.team_digest != team_digest:
        yield "it is not the mission with which the recorded team was started"
    elif mission.digest not in missions:
        yield "it is not a revision of the mission that was in force in the recordings"
    elif compile_mission(mission) != text:
        yield "it is not as mrbt writes it"


def _order(numbers: Mapping[str, int]) -> Iterator[str]:
    """Check that the revision is a later one than the mission with which the run began."""
    if len(numbers) > 1 and numbers[REVISION_FILE] <= numbers[MISSION_FILE]:
        yield f"it is not a later revision than {MISSION_FILE}"


def _end_of_commands(files: RunDirFiles, run: str) -> Iterator[str]:
    """Check the file against the summary's signature, which covers the last line at that time."""
    if files.summary is None or not files.summary.signature:
        return
    try:
        signed = parse_signature(files.summary.signature, run)
    except ValueError:
        return  # reported as a finding of the summary
    if signed.covered.commands not in heads(files.commands):
        yield f"it lacks lines that were there when {SUMMARY_FILE} was signed"


def _unsigned(noted: Sequence[NotedCommand]) -> Iterator[Gap]:
    lines = [each.number for each in noted if not each.signer and not each.problem]
    if lines:
        more = f" and {len(lines) - 1} more are" if len(lines) > 1 else " is"
        text = f"line {lines[0]}{more} not signed by an operator"
        yield Gap(GapKind.COMMANDS, COMMANDS_FILE, text, "give commands with the operator's key")
