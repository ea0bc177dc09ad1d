"""BehaviorTree.CPP's semantics, written from its documentation; others are held against it."""
