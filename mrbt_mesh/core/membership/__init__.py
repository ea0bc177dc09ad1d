"""Which robots are alive, and how all come to hold the same facts.

Where to find it:

- the robots that get a heartbeat, and those whose silence a robot judges: `dissemination`; in a
  large team: `ring`
- how long everything takes, when a heartbeat is sent: `timing`
- what is known of the others: `membership`; of one of them: `peer`
- when a robot is suspected, probed, declared dead: `failure_detector`
- when a new incarnation may take part: `joining`; two robots of one id: `duplicate_ids`
- where a lease is granted, renewed, given up: `leases`
- what this robot writes and takes in: `replica`; whom it asks for what it missed: `anti_entropy`
- the messages, and which are refused: `wire`; which member sent or wrote it: `keys`, `envelope`

Imports `facts` and what is below, never `planning`.
"""
