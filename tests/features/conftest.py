"""Fixtures that the tests of features share with those of the simulator."""

from __future__ import annotations

from tests.sim.conftest import _plans_are_those_of_the_definitions, run

__all__ = ["_plans_are_those_of_the_definitions", "run"]
