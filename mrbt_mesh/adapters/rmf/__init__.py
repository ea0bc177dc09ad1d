"""Open-RMF's task API from a fleet adapter's side: sends robots and jobs, answers requests.

`schemas/` is from rmf_api_msgs (Apache-2.0).
"""
