"""Runs the background functions of a robot's program: sensors, watchdogs, connections.

A function that fails costs the robot the capabilities that it was registered with, and is
restarted. The event loop does all waiting, so that a simulation can run it in virtual time.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable

import anyio

from mrbt_mesh.core.agent.inputs import CapabilityChanged, ProblemFound
from mrbt_mesh.core.mission.failure_reasons import MAX_REASON
from mrbt_mesh.runtime.task_port import Host
from mrbt_mesh.runtime.user_code import UserCodeError

# The pause before a restart: doubled at each failure.
FIRST_PAUSE_S = 1.0
MAX_PAUSE_S = 60.0


class BackgroundRunner:
    """Runs one background function, called by `call`, until it returns.

    `costs`: the capabilities that are lost after a failure. They come back when the function has
    run again for as long as the last pause. After MAX_PAUSE_S more, the pause is FIRST_PAUSE_S
    again. Without `costs` a failure is reported as a problem.
    """

    def __init__(
        self,
        name: str,
        source: str,
        costs: tuple[str, ...],
        call: Callable[[], Awaitable[None]],
        host: Host,
    ) -> None:
        self._name = name
        self._source = source
        self._costs = costs
        self._call = call
        self._host = host
        self._pause_s = 0.0

    async def run(self) -> None:
        """Run until the function returns, which is not a fault."""
        while (failure := await self._failure()) is not None:
            self._pause_s = min(max(FIRST_PAUSE_S, 2 * self._pause_s), MAX_PAUSE_S)
            self._tell(failure)
            await anyio.sleep(self._pause_s)
            self._host.log("info", "background_restarted", function=self._name)
        if self._pause_s:
            self._restore()

    async def _failure(self) -> UserCodeError | None:
        """Call the function once; return why it has failed, or None if it has returned."""
        failure = None
        async with anyio.create_task_group() as group:
            if self._pause_s:
                group.start_soon(self._recover)
            try:
                await self._call()
            except UserCodeError as error:
                failure = error
            group.cancel_scope.cancel()
        return failure

    async def _recover(self) -> None:
        """Restore the capabilities, and later the first pause, while the function runs again."""
        await anyio.sleep(self._pause_s)
        self._restore()
        await anyio.sleep(MAX_PAUSE_S)
        self._pause_s = 0.0

    def _tell(self, failure: UserCodeError) -> None:
        self._host.log(
            "error",
            "background_failed",
            function=self._name,
            error=failure.details,
            restarted_in_s=self._pause_s,
        )
        what = f"background function {self._name}"
        if not self._costs:
            text = failure_text("", failure.reason, self._pause_s)
            self._host.submit(ProblemFound(what, text))
        text = failure_text(f"{what} failed: ", failure.reason, self._pause_s)
        for capability in self._costs:
            self._host.submit(CapabilityChanged(capability, True, text, self._source))

    def _restore(self) -> None:
        self._host.log("info", "background_recovered", function=self._name)
        if not self._costs:
            self._host.submit(ProblemFound(f"background function {self._name}", ""))
        for capability in self._costs:
            self._host.submit(CapabilityChanged(capability, False, source=self._source))


def failure_text(before: str, reason: str, pause_s: float) -> str:
    """Return a failure in one line; if it is too long, the middle of `reason` is cut."""
    after = f", restarted in {pause_s:g} s"
    text, bracket, place = reason.rpartition(" (")
    place = f"{bracket}{place}" if text else ""
    left = MAX_REASON - len(before) - len(place) - len(after)
    text = text or reason
    if len(text) > left:
        text = text[: max(0, left - 1)].rstrip() + "…"
    return before + text + place + after
