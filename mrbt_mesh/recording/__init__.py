"""Recordings: what a robot or an observer knew and did, in the order in which it came.

`channels` has what is in a recording, with a JSON Schema each; `writer` and `reader` are the file
(MCAP, https://mcap.dev), `messages` what is in it. `robot_recorder` records an agent,
`observer_recorder` an observer; `scene` is what both have of the team in space, as `foxglove` draws
it. `player` shows a recording as it was. For readers: docs/how-to/recordings.md.
"""
