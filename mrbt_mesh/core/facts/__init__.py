"""What a team knows: entries, the map in which they join, and how the team reads it.

Where to find a rule:

- the contents of an entry, and its limits: `records`; whether it has a place here: `validation`
- which of two entries with one key counts: `store.join`
- how the team reads a condition, how often a guard has turned: `conditions`
- what is read in the tick in which an action returns: `bt.evaluation`
- when a global task has succeeded or failed, by either policy: `task_status`
- which coalition is at work, which is broken or in doubt: `coalitions`
- what is said of one activation: `activation_facts`
- how a robot describes itself, with what it has lost and how well it does now: `description`
- whose claim counts, what the operator's command is, what may be dropped: `team_facts`

Imports `mission` and what is below. Joining is commutative, associative and idempotent; whatever is
read is the same for the same entries, in whichever order they came. Changes are
followed by `FactMap.subscribe`.
"""
