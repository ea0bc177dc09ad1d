"""Who is alive, and how robots come to hold the same facts.

Where to find it:

- whom a robot beats to, and whose silence it judges: `ring`, `neighbourhood`
- who passes on what the others plan: `sections`
- how long everything takes: `timing`; when a heartbeat is sent: `heartbeat`
- what is known of the others: `membership`, `members`; of one of them: `peer`,
  `arrival_history`
- when a robot is suspected, probed, declared dead: `failure_detector`
- how much longer a robot that is slow itself waits for others: `local_health`
- when a new incarnation may take part: `joining`; two robots of one id: `duplicate_ids`
- where a lease is granted, renewed, given up: `leases`
- what this robot writes and takes in: `replica`; whom it asks for what it missed: `anti_entropy`
- the messages, and which are refused: `wire`; who may have said it: `keys`, `envelope`,
  `authorship`

Imports `facts` and what is below, never `planning`.
"""
