"""The live page: its frame times with a large team, its share of the processor, its pictures."""
