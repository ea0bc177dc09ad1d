"""Facts about the robot itself: its capabilities, and problems of its program and journal."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.effects import Persist
from mrbt_mesh.core.agent.inputs import (
    CapabilityChanged,
    JournalOpened,
    JournalReported,
    ProblemFound,
    RecordingReported,
)
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import (
    JOURNAL,
    NOT_ASKED,
    OF_ROBOT,
    RECORDING,
    RobotProblem,
    as_subject,
)
from mrbt_mesh.core.facts.store import Fact
from mrbt_mesh.core.mission.failure_reasons import one_line

MAX_PROBLEMS = 20


class Health:
    """Writes facts about the robot's capabilities and problems."""

    def __init__(self, context: Context) -> None:
        self._context = context
        # Problems kept back until a new incarnation, above all earlier ones, has joined.
        self._unsaid: dict[str, str] = {}
        self._recording_problem = context.config.recording_problem

    def joined(self, now_us: int) -> None:
        """Write the problems found before the robot joined. Problems of its program from an earlier
        incarnation are solved.
        """
        unsaid, self._unsaid = self._unsaid, {}
        found = {as_subject(subject) for subject in unsaid}
        known = self._context.facts.problems.get(self._context.me, {})
        past = {
            subject: "" for subject in known if subject not in found and subject not in OF_ROBOT
        }
        if facts := self.problem_facts(past | unsaid):
            self._context.write(facts, now_us)
        self.report_journal(now_us)
        self._report_recording(now_us)

    # -- problems of its program --------------------------------------------------------------

    def problem_found(self, event: ProblemFound, now_us: int) -> None:
        """Write the problem of a part of the program, or keep it until a new incarnation has
        joined.

        The team hears of the first MAX_PROBLEMS parts; the log has them all.
        """
        if self._context.is_new:
            self._unsaid[event.subject] = event.text
            return
        facts = self.problem_facts({event.subject: event.text})
        if facts:
            self._context.write(facts, now_us)

    def problem_facts(self, problems: Mapping[str, str]) -> list[Fact]:
        """The facts of new and of solved problems, without those that are already known."""
        context = self._context
        known = context.facts.problems.get(context.me, {})
        writes: dict[str, str] = {}
        for given, text in problems.items():
            subject, line = as_subject(given), one_line(text)
            has_room = subject in known or len(known) + len(writes) < MAX_PROBLEMS
            has_room |= subject in OF_ROBOT
            if has_room and known.get(subject, "") != line:
                if line:
                    level = "info" if line == NOT_ASKED else "error"
                    context.log(level, "problem", subject=subject, problem=line)
                writes[f"{records.PROBLEM}/{subject}"] = line
        return [(name, RobotProblem(writes[name])) for name in sorted(writes)]

    # -- its capabilities ---------------------------------------------------------------------

    def change_capability(self, change: CapabilityChanged, now_us: int) -> str | None:
        """Declare a minor fault or its end. Returns why that is impossible, or None."""
        description, name, source = self._context.description, change.local_task, change.source
        if not change.lost:
            return self._change(lambda: description.restore(name, source), now_us)
        more = (change.reason, source, change.is_pending, change.is_watched)
        return self._change(lambda: description.lose(name, *more), now_us)

    def change_performance(
        self, local_task: str, value: int, source: str, now_us: int
    ) -> str | None:
        """Declare a performance of this robot. Returns why that is impossible, or None."""
        description = self._context.description
        return self._change(lambda: description.perform(local_task, value, source), now_us)

    def _change(self, change: Callable[[], str | None], now_us: int) -> str | None:
        """Change the description, and write it if it differs. Returns what `change` does."""
        context, description = self._context, self._context.description
        before = description.changes()
        problem = change()
        if problem is not None:
            context.log("error", "capability_unknown", reason=problem)
            return problem
        after = description.changes()
        if after != before:
            context.log("warning", "capabilities_changed", **after)
            if context.has_place:
                context.write([context.member()], now_us)
        return None

    # -- its journal --------------------------------------------------------------------------

    def journal_reported(self, event: JournalReported, now_us: int) -> None:
        """Process a report that the journal can be written again, or cannot."""
        durability = self._context.durability
        durability.problem, durability.is_failing = event.problem, event.is_failing
        self.report_journal(now_us)

    def journal_opened(self, event: JournalOpened, now_us: int) -> None:
        """Write all other entries again, as the reopened journal holds only these."""
        context = self._context
        context.replica.restore(event.entries)
        held = {entry.hash for entry in event.entries}
        lacking = tuple(e for e in context.facts.map if e.hash not in held)
        context.log("warning", "journal_opened_anew", entries=len(event.entries))
        context.emit(Persist(lacking, True, context.durability.begin_anew()))
        self.report_journal(now_us)

    def report_journal(self, now_us: int) -> None:
        """Write the journal's problem, and whether it allows promises, if that has changed."""
        context, durability = self._context, self._context.durability
        may_promise = durability.may_promise
        is_news = context.description.may_promise != may_promise
        context.description.may_promise = may_promise
        if context.is_new:
            return
        facts = self.problem_facts({JOURNAL: durability.problem})
        if is_news:
            facts.append(context.member())
        if is_news and may_promise:
            context.log("info", "journal_works_again")
        if facts:
            context.write(facts, now_us)

    # -- its recording ------------------------------------------------------------------------

    def recording_reported(self, event: RecordingReported, now_us: int) -> None:
        """Process a report that the robot's recording works, or no longer does."""
        self._recording_problem = event.problem
        self._report_recording(now_us)

    def _report_recording(self, now_us: int) -> None:
        """Write why the robot does not record, if that has changed."""
        context = self._context
        facts = [] if context.is_new else self.problem_facts({RECORDING: self._recording_problem})
        if facts:
            context.write(facts, now_us)
