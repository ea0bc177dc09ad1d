"""What people see of a team: in a browser, in a terminal, as a recording or a report."""
