"""What a team knows: kinds of entries, the map that joins, how a team reads it, coalitions.

`records`: what an entry may be. `store`: how entries join. `validation`: which have a place in this
mission. `team_facts` reads them for the tree and for plans, by `conditions`, `activation_facts`
(what is said of one activation), `task_status` (when a task has succeeded or failed) and
`coalitions`.

Imports `mission` and what is below. Joining is commutative, associative and idempotent; whatever is
read from it is the same for the same entries, in whichever order they came.
"""
