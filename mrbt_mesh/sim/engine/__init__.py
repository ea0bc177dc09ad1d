"""One run: robots' processes on a virtual clock and a faulty network, and faults."""
