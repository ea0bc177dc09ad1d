"""A team, or a recording of one, in a terminal: `mrbt up`, `watch --top`, `recording replay`.

`team` holds the items of the view model; `lanes`, `robot_rows` and `tree_rows` make texts of them;
`rows`, `panes` and `app` are the screen.
"""
