"""Verifies whether the recordings of one run prove the team's work, alone and together.

Verified: the same facts led to the same plan, by the plain definitions; each robot followed its
plans; every takeover had a cause; and no recording contradicts another one. Signatures prove that
the recordings are those of their robots, and complete.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from functools import partial

from mrbt_mesh.core.facts.records import PROBLEM, RECORDING
from mrbt_mesh.core.facts.store import Incarnation, Version
from mrbt_mesh.core.membership.keys import Authorship
from mrbt_mesh.recording.metadata import NamedRecording
from mrbt_mesh.recording.reader import Recording, RecordingError
from mrbt_mesh.runtime.command_log import NotedCommand
from mrbt_mesh.runtime.member_keys import Manifest, was_signed
from mrbt_mesh.runtime.run_dir import MISSION_FILE, RUN_FILE, SUMMARY_FILE
from mrbt_mesh.runtime.summary_signature import Covered
from mrbt_mesh.views.replay.check_derived import early
from mrbt_mesh.views.replay.check_files import RunDirFiles, check_files
from mrbt_mesh.views.replay.check_recording import PlanAgain, RecordingCheck
from mrbt_mesh.views.replay.check_summary import covered_by
from mrbt_mesh.views.replay.check_team import TeamCheck, lives
from mrbt_mesh.views.replay.checked_recording import RecordedFact
from mrbt_mesh.views.replay.findings import Verification

NO_SUMMARY = (
    "without a signed summary.json, the end of commands.jsonl is not proved, nor that nothing was "
    "added to the recordings of killed robots"
)
NO_MISSION = f"{MISSION_FILE} is missing: the mission was checked as the recordings have it"
_Key = tuple[str, str, Version]


def verify(
    recordings: Sequence[Recording],
    manifest: Manifest | None = None,
    files: RunDirFiles | None = None,
    notes: Sequence[str] = (),
) -> Verification:
    """Verify at least one recording of one run, and the run's other files.

    The `manifest` checks signatures. `notes` become those of the result. Raises RecordingError if
    they are not of one run of one mission, or the mission cannot be read.
    """
    first = recordings[0]
    for each in recordings:
        if _run(each) != _run(first):
            raise RecordingError(f"{each.path} and {first.path} are of different runs")
    try:
        mission = first.metadata.read_mission(str(first.path))
    except ValueError as error:
        raise RecordingError(f"{first.path}: {error}") from None
    plans = PlanAgain(mission)
    authorship = None
    if manifest is not None:
        authorship = Authorship(partial(was_signed, manifest), first.metadata.run)
    checks = [RecordingCheck(each, plans, authorship) for each in recordings]
    # In parallel, because robots compute the same plans at about the same time.
    for _ in heapq.merge(*(check.steps() for check in checks)):
        pass
    _contradictions(checks)
    _missing(checks)
    for check, fact in early(checks):
        check.add(fact, f"{fact.author}'s {fact.name} is written before the time for it")
    summary = _covered(files, recordings, manifest)
    finished = _finished(recordings, summary)
    is_running = files is not None and files.is_running
    is_run_dir = files is not None and manifest is not None
    team = TeamCheck(checks, manifest, finished, is_run_dir, is_running)
    team.run()
    notes = [*notes, *team.notes]
    findings = [*team.findings, *(each for check in checks for each in check.findings)]
    commands: Sequence[NotedCommand] = ()
    if files is not None:
        missions = {each.metadata.mission_digest for each in recordings}
        missions |= {check.state.facts.in_force.digest for check in checks}
        revision = max(check.state.facts.in_force.number for check in checks)
        checked = check_files(files, recordings, manifest, missions, revision)
        findings += checked.findings
        team.gaps += checked.gaps
        notes += checked.notes
        commands = checked.commands
        if files.summary is None and not is_running:
            notes = [*notes, NO_SUMMARY]
        elif summary is not None and summary.afterwards_unix_s is not None:
            notes = [*notes, _afterwards(summary.afterwards_unix_s)]
        if RUN_FILE in files.others and MISSION_FILE not in files.missions:
            notes = [*notes, NO_MISSION]
    counts: Counter[str] = Counter()
    for check in checks:
        counts.update(check.counts)
    takeovers = [each for check in checks for each in check.takeovers]
    return Verification(
        tuple(each.name for each in recordings),
        manifest.authority.hex() if manifest is not None else "",
        dict(sorted(counts.items())),
        tuple(team.proved),
        tuple(team.gaps),
        tuple(findings),
        tuple(sorted(takeovers, key=lambda each: (each.at_us, each.robot, each.of))),
        (*notes, *(f"{each.name}: {each.begins_late}" for each in recordings if each.begins_late)),
        files.others if files is not None else (),
        tuple(commands),
        is_running,
        team.ends,
    )


def _covered(
    files: RunDirFiles | None, recordings: Sequence[Recording], manifest: Manifest | None
) -> Covered | None:
    """Return what was signed with the summary; None without one, or if it was changed."""
    if files is None or files.summary is None or manifest is None:
        return None
    return covered_by(files.summary, recordings[0].metadata.run, manifest)


def _finished(
    recordings: Sequence[Recording], summary: Covered | None
) -> list[tuple[str, NamedRecording]]:
    """Return which files say of which recordings that they were finished.

    A summary that was signed afterwards does not know what was changed before.
    """
    found = [(each.name, named) for each in recordings for named in each.metadata.earlier]
    if summary is not None and summary.is_of_the_end:
        found += [(SUMMARY_FILE, named) for named in summary.recordings]
    return [(by, named) for by, named in found if named.is_finished]


def _afterwards(unix_s: int) -> str:
    """Return the note about a summary that was signed after the run's end."""
    at = datetime.fromtimestamp(unix_s, UTC)
    return (
        f"{SUMMARY_FILE}: signed afterwards, at {at:%Y-%m-%d %H:%M:%S} UTC by status: what was "
        "changed before cannot be seen, nor whether commands.jsonl had more lines"
    )


def _run(recording: Recording) -> tuple[str, str]:
    return recording.metadata.run, recording.metadata.team_digest


def _contradictions(checks: Sequence[RecordingCheck]) -> None:
    """Check that a fact of one author, name and version is the same in all recordings, with one
    proof.
    """
    holders: dict[_Key, dict[tuple[int, bytes], list[tuple[RecordingCheck, RecordedFact]]]] = {}
    for check, fact in _all_facts(checks):
        key = (fact.author, fact.name, fact.version)
        same = holders.setdefault(key, {}).setdefault((fact.hash, fact.proof), [])
        same.append((check, fact))
    for (author, name, _), by_hash in holders.items():
        if len(by_hash) == 1:
            continue
        believed = max(by_hash.values(), key=lambda each: _weight(author, each))
        for rows in by_hash.values():
            if rows is not believed:
                check, fact = rows[0]
                against = {other.recording.name for other, _ in believed}
                check.add(fact, f"{author}'s {name} differs from the other recordings", against)


def _weight(author: str, rows: Sequence[tuple[RecordingCheck, RecordedFact]]) -> tuple[int, bool]:
    """Sort key: the majority is believed; on a tie, the author's recording."""
    names = {check.recording.name for check, _ in rows}
    return len(names), any(check.recording.metadata.robot == author for check, _ in rows)


def _missing(checks: Sequence[RecordingCheck]) -> None:
    """Report facts that others have of a robot, but its own recording lacks: it records before it
    sends.

    A robot that says itself that it does not record, e.g. on a full disk, has sent the rest
    unrecorded: its recording then has no end, which is a separate finding. Where a fact is missing,
    a fact that only its own recording has is a finding too.
    """
    owners: dict[tuple[str, Incarnation], list[RecordingCheck]] = {}
    own: set[tuple[str, str, Version, int]] = set()
    heard: set[tuple[str, str, Version, int]] = set()
    for check in checks:
        me = check.recording.metadata.robot
        for incarnation in lives(check.recording):
            owners.setdefault((me, incarnation), []).append(check)
        for fact in check.facts:
            (own if fact.author == me else heard).add(fact.whole)
    stopped = {
        (fact.author, fact.version.incarnation)
        for _, fact in _all_facts(checks)
        if fact.name == f"{PROBLEM}/{RECORDING}"
    }
    newest: dict[tuple[str, Incarnation], Version] = {}
    for author, _, version, _ in own:
        life = author, version.incarnation
        newest[life] = max(version, newest.get(life, version))
    missing: dict[tuple[str, str, Incarnation], set[str]] = {}
    for check, fact in _all_facts(checks):
        life = fact.author, fact.version.incarnation
        if life in stopped and (life not in newest or fact.version > newest[life]):
            continue
        authors = owners.get((fact.author, fact.version.incarnation), [])
        is_kept = all(
            each.begins_after is None or fact.version > each.begins_after for each in authors
        )
        if authors and is_kept and fact.whole not in own and not check.recording.damage:
            names = [each.recording.name for each in authors]
            check.add(fact, f"{fact.author} has not recorded its {fact.name}", names)
            missing.setdefault(fact.place, set()).add(check.recording.name)
    for check, fact in _all_facts(checks):
        others = missing.get(fact.place)
        is_own = fact.author == check.recording.metadata.robot
        if others is not None and is_own and fact.whole not in heard:
            text = f"no other recording has this {fact.name}, and others have a different one"
            check.add(fact, text, others)


def _all_facts(checks: Sequence[RecordingCheck]) -> Iterator[tuple[RecordingCheck, RecordedFact]]:
    return ((check, fact) for check in checks for fact in check.facts)
