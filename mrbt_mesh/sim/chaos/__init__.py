"""Random faults and missions, many seeds, and failures cut down to what is needed for them."""
