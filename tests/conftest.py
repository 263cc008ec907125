"""For all tests: what hypothesis tries may take as long as a busy computer needs."""

from hypothesis import HealthCheck, settings

settings.register_profile("busy computer", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("busy computer")
