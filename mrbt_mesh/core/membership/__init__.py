"""Which robots are alive, and how all robots come to hold the same facts.

Modules:

- the robots that get a heartbeat, and those whose silence a robot judges: `dissemination`; in a
  large team: `ring`
- all durations, and when a heartbeat is sent: `timing`
- what is known of all other robots: `membership`; of one robot: `peer`
- when a robot is suspected, probed, declared dead: `failure_detector`
- when a new incarnation may take part: `joining`; two robots with the same id: `duplicate_ids`
- clocks that stood still: `peer_clocks`
- what this robot writes and merges: `replica`; which peers it asks for facts: `anti_entropy`;
  facts that wait for proof: `unproved`
- the messages, and which are refused: `wire`; which member sent or wrote one: `keys`, `envelope`,
  `signed_reports`

Imports `facts` and the layers below it, never `planning`.
"""
