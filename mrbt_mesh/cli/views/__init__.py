"""What people see: plans, trees, teams and analyses, drawn from data alone."""
