"""The commands, a module for each group of them; their help alone imports little."""
