"""Measurements that a test must not assert: `python -m benchmarks --list`."""
