"""*Check Consistency* brought up to date: a matching and Hall witnesses."""
