"""What teams of 6 to 1,000 robots cost, and how fast they are: processes, and simulated ones."""
