"""One robot of the team as a pure object: inputs and time in, effects out.

`agent` shows each step from top to bottom: it passes each input to the handler for its type, then
decides and acts. Its parts take the `context` and the other parts that they need, never the agent.
From outside only `handle`, `next_deadline_us` and `view` are used.

Imports `engine`, `planning`, `membership` and the layers below them, never `observer`.
"""
