"""The robustness experiment of MRBTP (AAAI 2025): docs/explanation/robustness.md."""
