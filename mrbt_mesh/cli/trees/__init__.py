"""What the commands on tree files share: BehaviorTree.CPP files, and the trees of missions."""
