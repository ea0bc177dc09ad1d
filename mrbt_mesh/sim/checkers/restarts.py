"""I9: a robot that is started again resumes from its journal, and repeats nothing."""

from __future__ import annotations

from collections.abc import Iterable

from mrbt_mesh.core.agent.effects import Effect, Forget, Persist, Publish, StartAction
from mrbt_mesh.core.agent.inputs import Input, JournalOpened
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.facts.records import OUTCOME
from mrbt_mesh.core.facts.store import Entry, Version
from mrbt_mesh.core.membership.wire import MessageKind, decode, parse_entries
from mrbt_mesh.sim.checkers.facts import is_obsolete, is_revised_away, stands
from mrbt_mesh.sim.checkers.findings import RunFindings
from mrbt_mesh.sim.world.journal import Changes
from mrbt_mesh.sim.world.process import SimProcess


class Resumption:
    """Keeps its own account of what each robot has on disk, over all its lives.

    A robot's entries win over its earlier ones, also of earlier lives; nothing is published
    before it was handed to the journal; what is on disk is known after a restart, unless it was
    forgotten because nothing can reach it, or as soon as the disk can be read; no version is ever
    used for two contents; and no robot starts a local task again whose outcome it has on disk, and
    has read.
    """

    def __init__(self, run: RunFindings) -> None:
        self._run = run
        self._synced: dict[str, dict[tuple[str, str], Entry]] = {}
        self._versions: dict[tuple[str, str, Version], bytes] = {}

    def lost_journal(self, robot: str) -> None:
        """The robot has lost its disk."""
        self._synced.pop(robot, None)

    def booted(self, process: SimProcess, agent: AgentView) -> None:
        """A process has begun, and has read its journal if it could."""
        if process.has_read_journal:
            self._check_restored(process, agent, has_pruned=False)

    def synced(self, process: SimProcess, changes: Changes) -> None:
        """A process has put this on its disk."""
        synced = self._synced.setdefault(process.robot, {})
        for key, entry in changes.items():
            if entry is None:
                synced.pop(key, None)
            else:
                synced[key] = entry

    def _check_restored(self, process: SimProcess, agent: AgentView, has_pruned: bool) -> None:
        """`has_pruned`: it may have dropped again what its team has gone beyond meanwhile."""
        for entry in self._synced.get(process.robot, {}).values():
            self._run.checks["I9"] += 1
            may_lack = has_pruned and is_obsolete(agent, entry)
            if not (stands(agent, entry) or may_lack or is_revised_away(agent, entry)):
                text = (
                    f"{agent.robot} had synced {entry.name} {entry.version}, but starts without it"
                )
                self._run.violation("I9", text)

    def handled(self, process: SimProcess, event: Input, effects: Iterable[Effect]) -> None:
        if isinstance(event, JournalOpened):
            assert process.agent is not None
            self._check_restored(process, process.agent.view, has_pruned=True)
        written: dict[tuple[str, str], Entry] = {}
        for effect in effects:
            if isinstance(effect, Persist):
                for entry in effect.entries:
                    if effect.at_once:
                        self._write(entry)
                    written[entry.author, entry.name] = entry
            elif isinstance(effect, Forget):
                self._forget(process, effect.keys)
            elif isinstance(effect, Publish) and effect.kind is MessageKind.FACT:
                self._check_published(process, effect.data)
            elif isinstance(effect, StartAction):
                name = f"{OUTCOME}/{effect.activation}/{effect.local_task}"
                is_known = (process.robot, name) in self._synced.get(process.robot, {})
                if is_known and process.has_read_journal:
                    text = f"{process.robot} starts {name} again, of which it has the outcome"
                    self._run.violation("I9", text)
        for entry in written.values():
            self._check_written(process, entry)

    def _check_written(self, process: SimProcess, entry: Entry) -> None:
        """The newest that was written of a name in one step."""
        assert process.agent is not None
        found = process.agent.view.facts.map.get(entry.author, entry.name)
        if found is None or entry.record.write_once or found.record.rank():
            return
        if found.version != entry.version:
            text = f"{process.robot} writes {entry.name} {entry.version}, but {found.version}"
            self._run.violation("I9", f"{text}, which is older, wins")

    def _forget(self, process: SimProcess, keys: Iterable[tuple[str, str]]) -> None:
        assert process.agent is not None
        synced = self._synced.get(process.robot, {})
        for key in keys:
            entry = synced.get(key)
            if entry is not None and not is_obsolete(process.agent.view, entry):
                text = f"{process.robot} forgets {entry.name}, which can still be reached"
                self._run.violation("I9", text)

    def _check_published(self, process: SimProcess, data: bytes) -> None:
        assert process.agent is not None
        _, body = decode(data, process.agent.view.header, MessageKind.FACT)
        for entry in parse_entries(body)[0]:
            if (entry.author, entry.name, entry.version) not in self._versions:
                text = f"{process.robot} publishes {entry.name} {entry.version} before it is synced"
                self._run.violation("I9", text)

    def _write(self, entry: Entry) -> None:
        version = (entry.author, entry.name, entry.version)
        known = self._versions.setdefault(version, entry.packed)
        if known != entry.packed:
            text = f"{entry.author} uses version {entry.version} of {entry.name} for two contents"
            self._run.violation("I9", text)
