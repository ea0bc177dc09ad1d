"""A robot that has never heard another one reports that, and what it listens to, until it does.

Other robots may be at work out of earshot: their messages may be blocked, or go to another team.
`core.membership.joining` decides how long a robot waits before it begins alone.
"""

from __future__ import annotations

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.health import Health
from mrbt_mesh.core.agent.inputs import ProblemFound
from mrbt_mesh.core.facts.records import NETWORK


class Alone:
    """Reports that no other robot was heard. `is_over`: there is nothing left to report."""

    def __init__(self, context: Context, health: Health) -> None:
        self._context = context
        self._health = health
        self._is_said = False
        self.is_over = context.joining is None or not context.joining.expects_others

    def follow(self, now_us: int) -> None:
        """Report the problem once the expected robots are due, and its end once one was heard."""
        context, joining = self._context, self._context.joining
        if context.membership.peers:
            self.is_over = True
            if self._is_said:
                self._health.problem_found(ProblemFound(NETWORK, ""), now_us)
        elif not self._is_said and (joining is None or now_us >= joining.gathers_until_us):
            self._is_said = True
            listens, refused = context.config.listens, next(iter(context.refused), "")
            text = (
                f"no other robot was heard yet, on {listens}: check addresses, interfaces, "
                "firewalls, --team and --keys"
            )
            if refused:
                text = f"no other robot was heard yet; refused: {refused}"
            context.log("warning", "no_other_robot_heard", reason=text)
            self._health.problem_found(ProblemFound(NETWORK, text), now_us)
