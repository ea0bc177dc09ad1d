"""Tests of the project, in the order of its packages. What they share is in tests/support."""
