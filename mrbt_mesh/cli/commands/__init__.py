"""The commands: one module per group, which imports little unless a command is called."""
