"""What other programs understand: their protocols and files, fed from what an observer sees."""
