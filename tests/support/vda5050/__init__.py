"""AGVs for tests: a model of one, and a plant of real ones with a broker."""
