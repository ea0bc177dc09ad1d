"""What a team knows: entries, the map that joins them, and how the team reads it.

Where to find a rule:

- the contents of an entry, and its limits: `records`, `values`; whether the mission has a place for
  it: `validation`
- which of two entries with the same key wins: `store.join`
- how the team reads a condition, how often a guard has changed its value: `conditions`
- what is read in the tick in which an action returns: `bt.evaluation`
- when a global task has succeeded or failed, under each failure policy: `task_status`
- what is known of one activation: `activation_facts`
- how a robot describes itself, including its losses and present performances: `description`
- jobs: `jobs`; facts that follow from others: `derived`
- how far one robot can drive stamps and counts ahead: `stamps`
- whose claim counts, the operators' standing order, what may be dropped: `team_facts`

Imports `mission` and the layers below it. Joining is commutative, associative and idempotent: the
same entries are read the same way, in whichever order they arrived. Use `FactMap.subscribe` to
follow changes.
"""
