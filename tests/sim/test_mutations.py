"""Every deliberate bug is caught by the chaos run, within the seeds that are named here."""

from __future__ import annotations
