"""What holds for every test: properties are seeded and have no timed deadline."""

from hypothesis import HealthCheck, settings

# These machines are noisy: how long an example takes says nothing.
settings.register_profile("reprobe", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("reprobe")
