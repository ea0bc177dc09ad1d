"""Metrics for Prometheus, of each robot and of a whole team."""
