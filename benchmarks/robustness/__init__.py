"""The robustness experiment of MRBTP (AAAI 2025) on this project's agents: docs/robustness.md."""
