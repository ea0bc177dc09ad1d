"""What the commands in virtual time do: one run, many random ones, and figures of many."""
