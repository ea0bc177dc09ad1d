"""One robot of the team as a pure object: inputs and time in, effects out.

`agent` has each step from top to bottom: it takes inputs in, by a table from their type to a
handler, then decides and acts. Its parts take the `context` and those other parts that they need,
never the agent. From outside there is `handle`, `next_deadline_us` and `view`, nothing else.

Imports `engine`, `planning`, `membership` and what is below, never `observer`.
"""
