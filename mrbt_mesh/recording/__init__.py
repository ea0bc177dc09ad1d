"""Recordings: what one robot, or whoever watches, knew and did, in the order in which it came.

`channels` says what is in a recording, with a JSON Schema each; `writer` and `reader` are the file
(MCAP, https://mcap.dev), `encoding` its messages; `packing` makes facts and plans plain and facts
of plain data again. `robot_recorder` records an agent, `observer_recorder` an observer; `scene` is
what both show of the team in space, as `foxglove` draws it. For readers: docs/recording.md.

It may import formats and the core; it decides nothing, and nothing here changes what is recorded.
"""
