"""BehaviorTree.CPP's scripting language, and its conversions between types of values."""
