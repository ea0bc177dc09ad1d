"""What a revision keeps, from mission files and docs/how-to/revise.md alone.

It reads the files of `revision_files` as plain data, and nothing of the product.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from tests.support.revision_files import File

_CALL = re.compile(r"(\w+)(?:\((.*)\))?")


def split_call(call: str) -> tuple[str, list[str]]:
    found = _CALL.fullmatch(call)
    assert found is not None, call
    return found[1], found[2].split(",") if found[2] else []


class FileStep(NamedTuple):
    """A step of a file. `job_type`: that to whose tree it belongs, empty for that of the team.
    `local_task` has #1 in the place of a job's argument. `part`: the number of the outermost loop
    or node with memory around it, else its own. `depends_on`: all that makes it the same step.
    """

    job_type: str
    local_task: str
    most_robots: int
    is_exclusive: bool
    part: int
    depends_on: str

    def of(self, argument: str) -> str:
        """Its local task for a job with this argument."""
        return self.local_task.replace("#1", argument)


class FileJob(NamedTuple):
    """A job as it was submitted; type and argument are empty for the tree of the team."""

    id: str
    type: str
    argument: str


TEAM = FileJob("", "", "")


def may_have(file: File, job: FileJob) -> bool:
    """Whether a file has the type of a job, and that may have its argument."""
    if job == TEAM:
        return True
    kind = file["jobs"].get(job.type)
    if kind is None:
        return False
    (values,) = kind["parameters"].values()
    return job.argument in (file["travel"]["places"] if values == "place" else values)


def steps_of(file: File) -> list[FileStep]:
    """The steps of a file, in the order of its trees."""
    found = list(_Reader(file, "", []).steps(file["tree"]["Parallel"]["children"][0], 0))
    for number, (name, kind) in enumerate(sorted(file["jobs"].items()), 1):
        found += _Reader(file, name, [*kind["parameters"]]).steps(kind["tree"], number * 1_000)
    return found


class _Reader:
    """Reads the steps of one tree."""

    def __init__(self, file: File, job_type: str, parameters: Sequence[str]) -> None:
        self._file = file
        self._type = job_type
        self._parameters = parameters
        self._number = 0

    def steps(self, tree: Any, number: int) -> Iterator[FileStep]:
        self._number = number
        yield from self._visit(tree, frozenset(), None)

    def _visit(
        self, node: Any, guards: frozenset[str], part: tuple[int, str] | None
    ) -> Iterator[FileStep]:
        if isinstance(node, str):
            self._number += 1
            number, around = part or (self._number, "")
            local_task, most, is_exclusive, what = self._leaf(node)
            depends_on = repr((self._type, what, sorted(guards), around))
            yield FileStep(self._type, local_task, most, is_exclusive, number, depends_on)
            return
        kind, children, has_memory = _parts(node)
        if kind == "Condition":
            return
        if part is None and (has_memory or kind == "RetryUntilSuccessful"):
            self._number += 1
            part = self._number, self._shape(node)
        for child in children:
            yield from self._visit(child, guards, part)
            if kind == "Sequence" and not has_memory:
                guards |= {*self._guards_in(child)}

    def _leaf(self, call: str) -> tuple[str, int, bool, str]:
        """Its local task, the most robots, whether it is exclusive, and all that it is."""
        name, values = split_call(self._by_position(call))
        task = self._file["global_tasks"][name]
        ((need, bounds),) = task["needs"].items()
        for parameter, value in zip(task["parameters"], values, strict=True):
            need = need.replace(f"${parameter}", value)
        local = self._file["local_tasks"][split_call(need)[0]]
        at = local.get("at", "").replace("$p", values[0])
        most = bounds.get("max", bounds["min"])
        is_exclusive = task.get("exclusive", False)
        others = [task.get(each, False) for each in ("simultaneous", "preemptive")]
        policies = task.get("failure", "resilient"), is_exclusive, others
        what = (name, values, need, bounds["min"], most, policies, at)
        return need, most, is_exclusive, repr(what)

    def _by_position(self, text: str) -> str:
        for number, name in enumerate(self._parameters, 1):
            text = re.sub(rf"\${name}\b", f"#{number}", text)
        return text

    def _shape(self, node: Any) -> str:
        """A part with all that is below it, but for counts."""
        if isinstance(node, str):
            return self._leaf(node)[3]
        kind, children, has_memory = _parts(node)
        if kind == "Condition":
            return repr(node)
        return f"{kind}{has_memory}({', '.join(map(self._shape, children))})"

    def _guards_in(self, node: Any) -> Iterator[str]:
        """What a step behind this in a Sequence is guarded by."""
        if isinstance(node, str):
            return
        kind, children, has_memory = _parts(node)
        if kind == "Condition":
            yield node["Condition"]
        elif kind == "ForceSuccess" and _has_condition(node) and _has_step(node):
            yield f"whole {self._shape(node)}"
        elif not has_memory and kind != "ForceSuccess":
            for child in children:
                yield from self._guards_in(child)


def _parts(node: Any) -> tuple[str, list[Any], bool]:
    """Kind, children, and whether the node remembers which of these have ended."""
    ((kind, body),) = node.items()
    if kind == "Condition":
        return kind, [], False
    if isinstance(body, list):
        return kind, body, False
    if isinstance(body, dict) and "do" in body:
        return kind, [body["do"]], False
    if isinstance(body, dict) and "children" in body:
        return kind, body["children"], "memory" in body
    return kind, [body], False


def _has_condition(node: Any) -> bool:
    return not isinstance(node, str) and (
        "Condition" in node or any(map(_has_condition, _parts(node)[1]))
    )


def _has_step(node: Any) -> bool:
    return isinstance(node, str) or any(map(_has_step, _parts(node)[1]))


@dataclass
class Identities:
    """Which steps of the file in force are which of those before, and what is done of them.

    `steps`: of the file in force, each with its identity. `done`: (identity, job) -> successes.
    """

    steps: list[tuple[int, FileStep]] = field(default_factory=list)
    done: Counter[tuple[int, str]] = field(default_factory=Counter)
    all_steps: dict[int, FileStep] = field(default_factory=dict)
    # What a part depends on -> the identities of its steps, part by part: of the file in force, and
    # of those that were removed, in the order in which they were.
    _present: dict[str, list[list[int]]] = field(default_factory=dict)
    _retired: dict[str, list[list[int]]] = field(default_factory=dict)

    def take_up(self, file: File) -> None:
        """A file is in force: what is the same keeps its identity."""
        parts: dict[int, list[FileStep]] = defaultdict(list)
        for step in steps_of(file):
            parts[step.part].append(step)
        before, self._present, self.steps = self._present, {}, []
        for those in parts.values():
            key = repr([step.depends_on for step in those])
            known = before.get(key) or self._retired.get(key)
            first = len(self.all_steps)
            found = known.pop(0) if known else [*range(first, first + len(those))]
            self.all_steps |= zip(found, those, strict=True)
            self._present.setdefault(key, []).append(found)
            self.steps += zip(found, those, strict=True)
        for key, left in before.items():
            self._retired.setdefault(key, []).extend(left)

    def finish(self, job: FileJob, local_task: str) -> bool:
        """A local task has succeeded; False if every step that it can be of is done already."""
        for identity, step in self._of(job):
            if step.of(job.argument) == local_task:
                count = self.done[identity, job.id]
                if count < step.most_robots:
                    self.done[identity, job.id] += 1
                    return True
        return False

    def _of(self, job: FileJob) -> list[tuple[int, FileStep]]:
        return [each for each in self.steps if each[1].job_type == job.type]

    def missing(self, job: FileJob) -> list[str]:
        """The steps of a job that are not done."""
        return [
            step.of(job.argument)
            for identity, step in self._of(job)
            if not self.done[identity, job.id]
        ]

    def repeated_by(self, file: File, jobs: Sequence[FileJob]) -> list[str]:
        """The steps of these jobs that a file begins again, of tasks that are or were exclusive:
        the tree in force lacks them, and the same task was done under whatever guards.
        """
        after, present = self._copy(), {identity for identity, _ in self.steps}
        after.take_up(file)
        found = []
        for job in jobs:
            done = [
                (known.of(job.argument), known.is_exclusive)
                for identity, known in self.all_steps.items()
                if self.done[identity, job.id]
            ]
            for identity, step in after._of(job):
                name = step.of(job.argument)
                was_done = (name, True) in done or (step.is_exclusive and (name, False) in done)
                if was_done and identity not in present and not self.done[identity, job.id]:
                    found.append(f"{name} of {job.id}")
        return found

    def _copy(self) -> Identities:
        def copied(parts: dict[str, list[list[int]]]) -> dict[str, list[list[int]]]:
            return {key: list(those) for key, those in parts.items()}

        return Identities(
            list(self.steps),
            Counter(self.done),
            dict(self.all_steps),
            copied(self._present),
            copied(self._retired),
        )
