"""Scripts for a team of agents, in the manner of etcd/raft's golden files.

A block is a few commands, a line `----` and the events that followed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from mrbt_mesh.core.agent import inputs
from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.assignment.solvers import min_cost_flow
from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.tree import Memory, NodeSpec
from mrbt_mesh.core.engine import Engine
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.mission import (
    FailurePolicy,
    GlobalTask,
    Mission,
    MissionEnd,
    Recorded,
)
from mrbt_mesh.core.mission.travel import Travel
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.runtime.solver_loader import chosen_engine
from tests.support import build
from tests.support.harness import TIMING, Team
from tests.support.intruders import Intruders


def leaf(text: NodeSpec | str) -> NodeSpec:
    """`"fix"` is an action, `"?open"` a condition."""
    if isinstance(text, NodeSpec):
        return text
    return build.condition(text[1:]) if text.startswith("?") else build.action(text)


WORDS: dict[str, Callable[..., NodeSpec]] = {
    "Sequence": lambda *children: build.sequence(*map(leaf, children)),
    "SequenceWithMemory": lambda *children: replace(
        build.sequence(*map(leaf, children)), memory=Memory.WHILE_RUNNING
    ),
    "Fallback": lambda *children: build.fallback(*map(leaf, children)),
    "Parallel": lambda needed, *children: build.parallel(needed, *map(leaf, children)),
    "Retry": lambda limit, child: build.retry(limit, leaf(child)),
    "Timeout": lambda seconds, child: build.timeout(seconds, leaf(child)),
}


class Script:
    """Carries out the commands of a golden file, by robots that compute with `engine`."""

    def __init__(self, engine: Engine | None = None) -> None:
        self.team = Team()
        self.engine = engine or chosen_engine()
        self.robots: dict[str, dict[str, float]] = {}
        self.tasks: list[GlobalTask] = []
        self.tree: NodeSpec | None = None
        self.ends = MissionEnd.ONCE
        self.recorded = Recorded.IF_POSSIBLE
        self.at: dict[str, str] = {}
        self.starts: dict[str, str] = {}
        self.works: dict[str, int] = {}
        self._lives = 0
        self._intruders = Intruders(self.team)
        team, intruders = self.team, self._intruders
        self._commands: dict[str, Callable[..., None]] = {
            "kill": team.kill,
            "freeze": team.freeze,
            "thaw": team.thaw,
            "kill_router": team.kill_router,
            "cut": team.cut,
            "mend": team.mend,
            # ask B eye: a member asks B for its facts.
            "ask": intruders.ask,
            # forge B bytes: B receives again all that others have sent, changed: see `Intruders`.
            "forge": intruders.forge,
        }

    def block(self, commands: Sequence[str]) -> str:
        """Carry out some commands; returns the events that followed."""
        self.team.story.clear()
        for line in commands:
            text, _, _ = line.partition("#")
            if text.strip():
                word, *arguments = text.split()
                (self._commands.get(word) or getattr(self, f"do_{word}"))(*arguments)
        return "\n".join(self.team.story) or "ok"

    def do_robot(self, name: str, *capabilities: str) -> None:
        """robot A lift weld*0.5"""
        pairs = (each.partition("*") for each in capabilities)
        self.robots[name] = {local: float(value or 1) for local, _, value in pairs}

    def do_work(self, local_task: str, seconds: str) -> None:
        """work lift 4: a robot that does it as well as 1 takes 4 s."""
        self.works[local_task] = round(float(seconds) * 1e6)

    def do_task(self, name: str, *words: str) -> None:
        """task cover lift 2..2 fail_after=0.5; task dose pour exclusive in_doubt=retry;
        task fetch drive 1..1 bid_within=0.5; task look see failure=paper after=2"""
        needs: list[tuple[Any, ...]] = []
        policies: dict[str, Any] = {}
        for word in words:
            key, is_policy, value = word.partition("=")
            if word == "bid" or key == "bid_within":
                within_us = round(float(value) * 1e6) if is_policy else None
                needs[-1] = (*needs[-1], True, within_us)
            elif word in ("simultaneous", "exclusive"):
                policies[word] = True
            elif key == "in_doubt":
                from mrbt_mesh.features.exclusive.fields import InDoubtPolicy

                policies[key] = InDoubtPolicy(value)
            elif key == "failure":
                policies[key] = FailurePolicy(value)
            elif key == "after":
                policies["failure_after_us"] = round(float(value) * 1e6)
            elif is_policy:
                policies["blocked_fail_after_us"] = round(float(value) * 1e6)
            elif ".." in word:
                low, _, high = word.partition("..")
                needs[-1] = (needs[-1][0], int(low), int(high))
            else:
                needs.append((key, 1, 1))
        self.tasks.append(build.task(name, *needs, **policies))

    def do_tree(self, *words: str) -> None:
        self.tree = leaf(eval(" ".join(words), dict(WORDS)))

    def do_keys(self) -> None:
        """From now on robots have keys; so have an operator, op, and an observer, eye."""
        self._intruders.make_keys(list(self.robots))

    def do_command(self, name: str, who: str, *words: str) -> None:
        """command B op paused pause: a member commands B; `command B again`: it comes once more."""
        self._intruders.command(name, who, " ".join(words))

    def do_ends(self, when: str) -> None:
        """ends never: the team stands by when it is done."""
        self.ends = MissionEnd(when)

    def do_recorded(self, how: str) -> None:
        """recorded required: a robot that does not record takes no exclusive task."""
        self.recorded = Recorded(how)

    def do_at(self, place: str, *names: str) -> None:
        """at dock lift: lift happens there; at home A B: the robots are there at first."""
        for name in names:
            (self.starts if name in self.robots else self.at)[name] = place

    def mission(self, name: str = "m") -> Mission:
        assert self.tree is not None
        mission = build.make_mission(self.tree, self.robots, self.tasks, name=name)
        places = dict.fromkeys([*self.at.values(), *self.starts.values()], (0, 0))
        # Without schedules: these conversations are about ways.
        travel = Travel(places, self.at, self.starts, horizon=1) if places else None
        known = mission.local_tasks
        works = {name: replace(known[name], work=work) for name, work in self.works.items()}
        mission = replace(mission, local_tasks={**known, **works})
        return replace(mission, ends=self.ends, travel=travel, recorded=self.recorded)

    def do_start(self, *names: str) -> None:
        """start A B; start A2=A takeover: a second process under the id A

        patient: it waits up to 5 s for a team that gathers. unheard: up to 3 s if it hears nobody.
        """
        options = {"takeover", "exit_when_done", "alone", "patient", "unheard"}
        mission = self.mission()
        for name in names:
            if name not in options:
                self.launch(name, mission, options & set(names))

    def do_observe(self) -> None:
        """From now on an observer listens, or one more."""
        mission = self.mission()
        observer = Observer(mission, build.RUN, TIMING, min_cost_flow, self.engine)
        self.team.observers.append(observer)

    def do_stranger(self, name: str) -> None:
        """A robot that runs another mission file."""
        self.launch(name, self.mission("another"), set())

    def launch(self, name: str, mission: Mission, options: set[str]) -> None:
        process, _, robot = name.partition("=")
        robot = robot or process
        self._lives += 1
        config = AgentConfig(
            robot,
            "T",
            build.micro(self.robots[robot]),
            build.RUN,
            f"n{self._lives}",
            min_cost_flow,
            TIMING,
            expected=frozenset(() if "alone" in options else self.robots),
            gather_us=5_000_000 if "patient" in options else 0,
            alone_after_us=3_000_000 if "unheard" in options else 0,
            takeover="takeover" in options,
            exit_when_done="exit_when_done" in options,
            engine=self.engine,
            keys=self._intruders.keys.get(robot),
            life=self._lives,
        )
        self.team.start(process, mission, config)

    def do_pass(self, ms: str) -> None:
        self.team.pass_time(int(ms))

    def end_action(self, name: str, success: bool, words: tuple[str, ...], error: str = "") -> None:
        process = self.team.processes[name]
        conditions = tuple((k, v == "true") for k, _, v in (w.partition("=") for w in words))
        ticket = process.tickets.pop()
        event = inputs.ActionFinished(ticket, success, conditions, error)
        self.team.give(process, event)

    def do_succeed(self, name: str, *conditions: str) -> None:
        """succeed A open=true"""
        self.end_action(name, True, conditions)

    def do_cannot_reach(self, name: str, *words: str) -> None:
        """cannot_reach A road is closed: its program cannot reach the place."""
        process = self.team.processes[name]
        event = inputs.ActionFinished(process.tickets.pop(), False, reason=" ".join(words))
        self.team.give(process, event)

    def do_fail(self, name: str, *conditions: str) -> None:
        self.end_action(name, False, conditions)

    def do_raise(self, name: str) -> None:
        """The action's code raises: the runtime reports a failure with the traceback."""
        self.end_action(name, False, (), "Traceback: ZeroDivisionError")

    def do_bid(self, name: str, *words: str) -> None:
        """bid A fetch=-3 carry=none: what its program says to what it was asked, all at once."""
        from mrbt_mesh.features.bids.messages import BidMade, BidsMade

        process = self.team.processes[name]
        values = dict(word.split("=") for word in words)
        bids = []
        for asked in [a for a in process.asked if a.local_task in values]:
            text = values[asked.local_task]
            value = None if text in ("none", "raises") else round(float(text) * 1e6)
            error = "Traceback: ZeroDivisionError" if text == "raises" else ""
            bids.append(BidMade(asked.activation, asked.local_task, value, error))
            process.asked.remove(asked)
        self.team.give(process, BidsMade(tuple(bids)))

    def do_set(self, name: str, condition: str) -> None:
        key, _, value = condition.partition("=")
        self.team.give(self.team.processes[name], inputs.ConditionSet(key, value == "true"))

    def do_stop_slowly(self, name: str) -> None:
        """From now on a cancelled action takes its time."""
        self.team.processes[name].stops_at_once = False

    def do_stopped(self, name: str) -> None:
        process = self.team.processes[name]
        self.team.give(process, inputs.ActionStopped(process.tickets.pop(0)))

    def do_tell(self, name: str, command: str, *words: str) -> None:
        """tell A fault lift"""
        self.team.command(name, command, " ".join(words))

    def do_operate(self, name: str, field: str, value: str) -> None:
        """operate A paused pause; operate A aborted true: a command, as its operator's client sends
        it to A alone.
        """
        self.team.operate(name, field, True if value == "true" else value)

    def do_decide(self, name: str, activation: str, decision: str) -> None:
        """decide A dose retry: about the first coalition that has left a global task in doubt."""
        from mrbt_mesh.features.exclusive.coalitions import granted, grantors

        facts = self.team.processes[name].agent.view.facts
        for known, found in granted(facts):
            doubted = found.in_doubt(grantors(facts))
            if parse_activation(known).subject == activation and doubted:
                self.team.operate(name, f"decision/{known}/{doubted[0]}", decision)

    def do_leave(self, name: str) -> None:
        self.team.give(self.team.processes[name], inputs.LeaveRequested())

    def do_disk(self, name: str, how: str) -> None:
        """disk A slow: nothing is synced; disk A full: nor can it be; disk A works"""
        process = self.team.processes[name]
        was_full, process.is_disk_full = process.is_disk_full, how == "full"
        process.is_disk_slow = how != "works"
        if was_full != process.is_disk_full:
            problem = "journal cannot be written: No space left on device"
            report = inputs.JournalReported(problem if how == "full" else "", how == "full")
            self.team.give(process, report)
        self.team.sync(process)
        self.team.give(process, inputs.TimerFired())

    def do_recording(self, name: str, how: str) -> None:
        """recording A ends: what A does is not recorded any more; recording A works"""
        problem = "does not record: No space left on device" if how == "ends" else ""
        self.team.give(self.team.processes[name], inputs.RecordingReported(problem))

    def do_router(self, router: str, *names: str) -> None:
        """router r1 A B: from now on these are linked to it, and to others only by it."""
        for name in names:
            self.team.change_router(name, router)

    def do_show(self) -> None:
        """What every robot thinks: its mission's status, who is alive, who does what."""
        for process in self.team.processes.values():
            agent = process.agent
            if agent.view.plan is None:
                self.team.story.append(f"{process.name}: joining")
                continue
            alive = ",".join(robot for robot in agent.view.alive() if robot != agent.view.robot)
            lines = " ".join(f"{r}:{x.local_task}" for r, x in agent.view.plan.assignments.items())
            waiting = "".join(f"; {w.global_task} {w.reason}" for w in agent.view.plan.waiting)
            status = agent.view.plan.result.name.lower()
            hears = f"hears {alive or 'nobody'}"
            where = self.where(agent.view.facts)
            self.team.story.append(
                f"{process.name}: {status}; {hears}; {lines or 'no work'}{waiting}{where}"
            )

    def where(self, facts: TeamFacts) -> str:
        """Where the robots are, and to which places they are on their way."""
        ways = ((r, facts.place_of(r), facts.under_way(r)) for r in self.robots if self.starts)
        return "".join(
            f"; {r} {'from' if to else 'at'} {at}{to and ' to '}{to}" for r, at, to in ways
        )
