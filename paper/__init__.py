"""The paper's example, run again and written down: `python -m paper` writes docs/data/paper.md.

`account` runs the mission, `scene` says what its record shows at a moment, `situations` finds
the paper's eight, `picture` draws them, `standing` runs the team from one damage to the next,
`tables` and `tolerance` derive the figures, `document` puts all of it together.
"""
