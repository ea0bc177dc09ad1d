"""Many runs with faults by chance: how likely a mission succeeds, and how long it takes."""
