"""Open-RMF's task API, as a fleet adapter speaks it: robots and jobs, and requests for them.

`schemas/` is from rmf_api_msgs (Apache-2.0).
"""
