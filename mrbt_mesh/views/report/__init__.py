"""Reports on runs, from their recordings or from the summaries that commands wrote.

`recorded` and `summaries` make the figures of `model`; `page` and `gantt` draw them.
"""
