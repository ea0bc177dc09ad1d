"""The team in a terminal: `mrbt watch --top`, and the lanes that `mrbt up` shows as well.

It draws what `viewmodel` tells. Only `app`, `panes`, `questions` and `rows` need textual.
"""
