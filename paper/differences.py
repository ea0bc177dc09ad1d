"""What is done otherwise than the paper says, for docs/paper.md."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

WIDTH = 100


@dataclass(frozen=True)
class Difference:
    """One difference: where the paper says what, what is done here, and why."""

    title: str
    place: str
    paper: str
    here: str
    why: str

    def lines(self) -> list[str]:
        """As an item of a list."""
        text = (
            f"- **{self.title}** ({self.place}). *Paper:* {self.paper} *Here:* {self.here} "
            f"*Why:* {self.why}"
        )
        return textwrap.wrap(
            text, WIDTH, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
        )


IN_THE_METHOD = (
    Difference(
        "When a global task has succeeded",
        "Section V, definition of T_G",
        "the successes of a local task must be greater than ν.",
        "at least ν.",
        "the paper's own remark in the same sentence says that the minimum amount has "
        "succeeded, and with ν = μ = 2, as for Remove Cover in Section VI, more than ν cannot "
        "succeed.",
    ),
    Difference(
        "When a global task has failed",
        "Section V, definition of T_G",
        "the failures of a local task exceed Σ r(i, j) − ν: the assigned robots that have not "
        "failed are fewer than ν. Robots that are not assigned do not count.",
        "by default (`failure: resilient`) when one has failed, and the successes and the "
        "capable robots that have not tried are fewer than ν. The dead and those that have "
        "lost the capability are counted out once the team has agreed on that for the "
        "detection time; with `patient` they are waited for. `failure: paper` is the paper's "
        "count, with two additions: assigned are the robots with an outcome and those with a "
        "claim, and one must have failed.",
        "with one robot assigned and others free, the paper's rule fails the task at the "
        "first failure. And before anybody is assigned it reads 0 > −ν, which is a failure of "
        "nobody. [Decision 0013](decisions/0013-failure-needs-a-failure.md).",
    ),
    Difference(
        "a_j and b_j when a local task ends",
        "Section V, definition of T_A, below equation (2)",
        "whether it has succeeded or failed, both decrease by 1 until a_j = 0.",
        "a_j is ν − successes: a failure leaves it as it is. b_j is μ − successes − failures, "
        "but at least a_j. When ν have succeeded nobody new is assigned, and robots at work "
        "finish. A robot that has an outcome is not assigned to the same activation again.",
        "with a failure subtracted from a_j, fewer robots would be asked for than the task "
        "still needs to succeed.",
    ),
    Difference(
        "Bounds per request",
        "Section V, equation (2)",
        "one pair of bounds a_j, b_j for each local task l_j, whichever global task asks for it.",
        "a pair for each local task of each running global task.",
        "two global tasks that run at the same time may need the same local task, and each "
        "has its own ν and μ. With one counter the end of one would set the bounds of the "
        "other to 0.",
    ),
    Difference(
        "Local tasks that need nobody",
        "Section IV, ψ and ν; Section V, definition of T_A",
        "every local task in ψ(g) has to return success, and a request sets a_j to a positive "
        "value.",
        "with `min: 0`, ν = 0, robots may help, up to μ, until the global task has ended. It "
        "succeeds without them, and their failure is ignored. At least one local task of a "
        "global task has ν > 0.",
        "helpers make work faster where robots are free, without being waited for.",
    ),
    Difference(
        "What makes T_A plan",
        "Section V, definition of T_A",
        "the conditions Local Task Finished and New Global Task Executed; without either T_A "
        "fails, and with it T_i, equation (1).",
        "Local Task Finished also holds when a robot has died, left or joined, New Global "
        "Task Executed whenever a fact has changed: an outcome, a condition, a claim, a "
        "capability. Without a trigger T_A keeps its last status. The mission's result is "
        "that of T_G.",
        "a fault changes the problem of equation (2) although no task ends and none begins. "
        "And having nothing to plan is no failure.",
    ),
    Difference(
        "Which requests are served",
        "Section IV, assumption 1; Section V, Check Consistency",
        "the robots suffice for all global tasks that run in parallel; a constraint is added "
        "only if a solution exists, in no stated order.",
        "requests are taken in the order of the tree, and each is kept if all kept so far "
        "have a solution. The others wait. Check Consistency fails if there are requests and "
        "none is kept.",
        "all robots must keep the same requests, and at times there are too few robots.",
    ),
    Difference(
        "Robots at work",
        "Section V, equation (2)",
        "every assignment is solved anew for all robots.",
        "a robot that runs a local task stays with it. It is taken off only if its own "
        "request cannot be kept and another one then can, or for a task that is `preemptive`. "
        "The rest is assigned optimally, and of several optima all robots take the same one.",
        "an assignment that is slightly better is not worth work that is lost, and robots "
        "that each solve for themselves need one answer. [Decision "
        "0012](decisions/0012-canonical-optimum.md).",
    ),
    Difference(
        "What is done again",
        "Section III; Section VI-A",
        "nodes have no memory, and what an action returns at the ticks after it has ended is "
        "not said. When Normal Operating Conditions turns false, Remove Screws is executed "
        "(again).",
        "an action keeps its outcome until conditions have made the tree stop asking for it; "
        "when it is asked for again it is done again. Late outcomes renew nothing.",
        "a Sequence would never get past an action that is executed again at every tick. "
        "[Decisions 0002](decisions/0002-activations-named-by-causes.md) and "
        "[0044](decisions/0044-guards-are-expressions.md).",
    ),
    Difference(
        "The lemmas on fault tolerance",
        "Section V-B, lemmas 1 and 2",
        "a condition on capabilities, and equation (2) consistent under r(i, j) · r(h, j) = 0.",
        "`mrbt analyze` tries all faults.",
        "the lemmas as printed answer otherwise in some missions (`paper/lemmas.py`).",
    ),
)

IN_THE_EXAMPLE = """
- The paper's table of bounds has a row for (Place Screws, Remove Cover) with ν = 1 and
  μ = 2. Removing the cover is no local task, so the row has no counterpart here.
- The paper's situation V has hardware put into parts 2 and 4, situation VI has wires put
  into parts 1 and 2. Here it is parts 2 and 4 throughout.
- Its normal operating condition counts as a global task; here it is a condition.
- Both robots that move the cover start at the same time (`simultaneous`), which ν = 2
  alone does not ask for.
""".strip()


def differences() -> list[str]:
    """The section of docs/paper.md."""
    return [
        "## Where it differs from the paper",
        "",
        "### In the method",
        "",
        *(line for each in IN_THE_METHOD for line in each.lines()),
        "",
        "### In the example",
        "",
        *IN_THE_EXAMPLE.splitlines(),
        "",
    ]
