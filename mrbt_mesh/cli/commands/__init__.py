"""One file for each command: `mrbt kill` is the function `kill` in `kill.py`.

A command's file says what the command takes and what it is for; its first line of help is repeated
here, so that `mrbt --help` imports no command. The file is imported for its help screen alone too:
what the command works with, it imports when it is called.
"""

from __future__ import annotations

PANELS = {
    "Run a team": {
        "demo": "Run an example: without a name, six robots that repair a vehicle (about 30 s).",
        "up": "Start one process per robot and watch the mission.",
        "watch": "Watch a team that runs already, or is yet to come; ending the view leaves it "
        "alone.",
        "web": "Show a team in the browser: its tree, robots, timeline, and why; until Ctrl-C.",
        "top": "Show a team in this terminal, by keys: its tree, robots, timeline, and why; q ends "
        "it.",
        "groot2": "Show a team's tree live in Groot2, or in any other monitor of BehaviorTree.CPP.",
        "status": "Tell who does what, what is blocked, and whether all agree.",
        "join": "Start one more robot of the running mission, or a dead one again.",
        "agent": "Run one robot, anywhere on the network.",
        "router": "Pass messages on between robots that do not reach each other.",
    },
    "Act on a running team": {
        "kill": "Kill a robot's process with SIGKILL: a major fault.",
        "freeze": "Freeze a robot's process with SIGSTOP: it falls silent, but its links stay up.",
        "thaw": "Let a frozen robot go on with SIGCONT.",
        "fault": "Make a robot lose a capability, or do something better or worse.",
        "restore": "Let a robot do again what it had lost.",
        "leave": "Have a robot leave on purpose: its work is handed over at once.",
        "pause": "Stop all work until `mrbt resume`.",
        "resume": "Go on after `mrbt pause`.",
        "abort": "End the mission as failed. It cannot be taken back.",
        "decide": "Say how an exclusive task goes on whose robot vanished in the middle of it.",
    },
    "Without a network": {
        "validate": "Check a mission file and its robots' program; say what it holds.",
        "plan": "Plan for given facts and explain the plan.",
        "assign": "Solve one assignment problem, exactly and canonically.",
        "analyze": "Tell which faults a mission survives, and what would make it survive more.",
        "sim": "Run a mission once in virtual time, with the faults that you name.",
        "estimate": "Estimate how likely a mission succeeds and how long it takes when robots fail "
        "by chance.",
        "lift": "Make a team's mission out of the tree that drives one robot, and explain it.",
        "tree": "Show, check and convert trees: BehaviorTree.CPP files and missions.",
        "new": "Write a small mission and a robot of your own that run at once; or copy an "
        "example.",
        "keys": "Make and change the keys by which a team knows who says what.",
    },
    "Prove it": {
        "replay": "Show a recorded run again, at any speed, forwards and back.",
        "report": "Report on runs: results, who worked and waited when, faults and takeovers.",
        "verify": "Prove from the recordings of a run what its robots did, and find what was "
        "falsified.",
        "what-if": "Go on from a moment of a recorded run in the simulator, with faults that did "
        "not happen.",
        "chaos": "Run a mission with random faults, many times, and check what must always hold.",
        "drill": "Run drills: real processes, faults at chosen moments, verdicts from what was "
        "done.",
    },
}
