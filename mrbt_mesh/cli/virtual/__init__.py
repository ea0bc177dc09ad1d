"""Virtual time: one run with named faults, many with random ones."""
