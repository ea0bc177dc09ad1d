"""One robot of the team as a pure object: inputs and time in, effects out.

`agent` puts the parts together, `follow_up` says what follows from an input. The parts, `planner`,
`executor`, `reports`, `heartbeats`, `inbound`, `lifecycle` and `commands`, take the `context` and
those other parts that they need, never the agent. From outside there is `handle`,
`next_deadline_us` and `view`, nothing else.

Imports `engine`, `planning`, `membership` and what is below, never `observer`.
"""
