"""A passive replica, and the record of a run that it keeps.

Imports `engine`, `planning`, `membership` and what is below, never `agent`.
"""
