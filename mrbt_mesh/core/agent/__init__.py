"""One robot of the team as a pure object: inputs and time in, effects out.

Imports `engine`, `planning`, `membership` and what is below, never `observer`.
"""
