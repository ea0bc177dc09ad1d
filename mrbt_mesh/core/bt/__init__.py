"""Behavior trees: nodes as data, activations, and the definition of a tick.

Where to find it:

- kinds of nodes, how a tree is built and checked: `tree`
- the rule of each kind (a Parallel's, say), and what a node with memory does: `evaluator`
- the facts that an evaluation reads, and its result: `evaluation`
- the activation that an outcome belongs to, and when it is obsolete: `activation`; guards: `guards`
- T_i, the tree that every robot runs: `robot_tree`

Imports nothing of the project. A tree holds no run state; nothing here is written for speed.
"""
