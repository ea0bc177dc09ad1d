"""Prometheus metrics of each robot and of a whole team."""
