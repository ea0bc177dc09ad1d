"""Settings of the property tests: a failure prints what replays it, and no clock decides."""

from hypothesis import HealthCheck, settings

settings.register_profile(
    "core", deadline=None, print_blob=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("core")
