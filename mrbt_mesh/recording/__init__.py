"""Recordings: what a robot or an observer knew and did, in order.

`channels` lists the contents of a recording, each with a JSON Schema; `writer` and `reader` handle
the file (MCAP, https://mcap.dev), `messages` its messages. `robot_recorder` records an agent,
`observer_recorder` an observer; `scene` is the team in space, for both, as drawn by `foxglove`.
`player` plays a recording. For readers: docs/how-to/recordings.md.
"""
