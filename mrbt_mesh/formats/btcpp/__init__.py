"""BehaviorTree.CPP v4 XML: reading, checking, writing, and its scripting language."""
