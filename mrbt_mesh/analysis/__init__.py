"""What can be told of a mission beforehand: its tree for a team, the faults that it survives."""
