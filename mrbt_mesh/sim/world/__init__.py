"""One run: robots' processes on a virtual clock and a faulty network, and faults.

`setup` has all that decides a run, `world` holds it. `robots` starts and ends `process`es, each
with an agent, a `journal` and a robot's program; `message_bus` and `network` are between them;
`clock` is the time. `faults` are carried out by `injector` (`scenario`: as JSON); `failures`
happen by chance. `sharing` lets robots of one process work things out once.

It imports nothing else of `sim`. All chance comes from the seed.
"""
