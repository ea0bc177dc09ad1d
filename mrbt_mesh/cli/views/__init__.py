"""Plans, teams, runs and statistics as people read them in a terminal."""
