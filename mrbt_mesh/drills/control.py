"""Commands to a team that is watched: faults of processes on this machine, commands, drills.

The live page and `mrbt watch --top` offer them.
"""

from __future__ import annotations

from typing import Any

import anyio.abc

from mrbt_mesh.core.agent.operator_messages import FAULT, LEAVE, RESTORE
from mrbt_mesh.drills.inject import DrillInjector
from mrbt_mesh.drills.model import StepModel
from mrbt_mesh.drills.triggers import Snapshot
from mrbt_mesh.drills.watched import REFUSALS, TeamDrills
from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.command_log import note_command
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.operator_call import CommandRefusedError
from mrbt_mesh.runtime.team import Team
from mrbt_mesh.runtime.team_client import TeamClient
from mrbt_mesh.runtime.watcher import Watcher

# What can be done to a process of this machine: command -> (key of a drill's step, description).
FAULTS = {
    "kill": ("kill", "Kill the process (SIGKILL). The others notice, and one takes its work over."),
    "freeze": ("stop", "Freeze the process (SIGSTOP). It falls silent and is replaced."),
    "thaw": ("continue", "Let a frozen process go on (SIGCONT). It gives way to its replacement."),
    "join": ("restart", "Start the robot again. It joins, and the plan counts on it."),
}
WORDS = {
    "lose": (FAULT, "Have the robot lose a capability. Another one does that from now on."),
    "restore": (RESTORE, "Give back what the robot has lost."),
    "leave": (LEAVE, "Have the robot leave on purpose. It hands its work over at once."),
}
TEAM_COMMANDS = {
    "pause": "Stop all work, until it is resumed.",
    "resume": "Go on with the work.",
    "abort": "End the mission as failed. It cannot be taken back.",
}


class CommandError(Exception):
    """A command was not carried out; the message has the reason."""


class Control:
    """Carries out commands. `team` is None if no process runs on this machine."""

    def __init__(self, watcher: Watcher, team: Team | None, group: anyio.abc.TaskGroup) -> None:
        self._watcher = watcher
        self._team = team
        self._drills = TeamDrills(watcher, team, group) if team is not None else None

    def offers(self) -> dict[str, Any]:
        """Return the available commands, and what each will do."""
        robots = {name: text for name, (_, text) in WORDS.items()}
        if self._team is not None:
            robots = {name: text for name, (_, text) in FAULTS.items()} | robots
        return {"robot": robots, "team": TEAM_COMMANDS, "drills": self._drills is not None}

    async def drills(self) -> list[dict[str, Any]]:
        """Return the drills that fit this team. Raises CommandError if a drill file is wrong."""
        try:
            return [] if self._drills is None else await self._drills.known()
        except InputError as error:
            raise CommandError(str(error)) from error

    async def carry_out(self, command: Any) -> str:
        """Carry out a command, and return what was done. Raises CommandError."""
        text = await self._carry_out(command)
        if self._team is not None:
            try:
                note_command(self._team.run_dir, f"a view: {command['act']}", text)
            except InputError as error:
                return f"{text}; {error}"
        return text

    async def _carry_out(self, command: Any) -> str:
        match command:
            case {"act": str(act), "robot": str(robot)} if act in FAULTS:
                return await self._fault(act, robot)
            case {"act": str(act), "robot": str(robot)} if act in WORDS:
                task = command.get("local_task", "all")
                return await self._word(act, robot, task if isinstance(task, str) else "all")
            case {"act": str(act)} if act in TEAM_COMMANDS:
                return await self._command(act)
            case {"act": "drill", "label": str(label)} if self._drills is not None:
                return await self._drill(self._drills, label)
        raise CommandError("no such command")

    def _known(self, robot: str) -> None:
        observer = self._watcher.observer
        known = {*observer.robots(), *observer.mission.robots}
        if robot not in known:
            raise CommandError(f"the team has no robot {robot[:32]!r}")

    async def _fault(self, act: str, robot: str) -> str:
        self._known(robot)
        if self._team is None:
            raise CommandError("no process of this team runs on this machine")
        has_process = self._team.process(robot) is not None
        if act == "join" and has_process:
            raise CommandError(f"{robot} runs already")
        if act != "join" and not has_process:
            raise CommandError(f"no process of {robot} runs on this machine")
        texts: list[str] = []
        injector = DrillInjector(
            self._team, self._watcher, None, None, lambda fault: texts.append(fault.text)
        )
        key, _ = FAULTS[act]
        step = StepModel.model_validate({"after": 0, key: robot})
        try:
            snapshot = Snapshot.of(self._watcher.observer, (), boottime_us())
            await injector.carry_out(step, snapshot)
        except REFUSALS as error:
            raise CommandError(str(error)) from error
        if injector.injected.problems:
            raise CommandError("; ".join(injector.injected.problems))
        return f"{robot}: {', '.join(texts)}"

    async def _word(self, act: str, robot: str, local_task: str) -> str:
        self._known(robot)
        command, _ = WORDS[act]
        argument = "" if command == LEAVE else local_task
        return self._answered(await self._watcher.command(robot, command, argument))

    async def _command(self, act: str) -> str:
        client = TeamClient(self._watcher)
        if not client.robots:
            raise CommandError("no robot answers")
        give = {"pause": client.pause, "resume": client.resume, "abort": client.abort}[act]
        try:
            return (await give()).text(f"{act} is the team's command")
        except (CommandRefusedError, TimeoutError) as error:
            raise CommandError(f"{act}: {error}") from error

    async def _drill(self, drills: TeamDrills, label: str) -> str:
        try:
            return await drills.start(label)
        except InputError as error:
            raise CommandError(str(error)) from error

    def _answered(self, answer: tuple[bool, str]) -> str:
        good, text = answer
        if not good:
            raise CommandError(text)
        return text
