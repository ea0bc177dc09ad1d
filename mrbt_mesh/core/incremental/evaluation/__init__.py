"""Evaluating a tree again: only what changed facts can influence (`bt.evaluator`)."""
