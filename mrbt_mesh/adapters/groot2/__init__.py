"""Groot2 and BehaviorTree.CPP's other monitors: their protocol over ZeroMQ."""
