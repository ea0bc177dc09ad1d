"""What the commands on a running team share: its processes, words to its robots, its status."""
