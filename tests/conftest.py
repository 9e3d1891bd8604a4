"""Settings that all tests share."""

from hypothesis import settings

# Two test processes share the machine: a deadline in wall time would measure the neighbour, not the code.
settings.register_profile("shared machine", deadline=None, print_blob=True)
settings.load_profile("shared machine")
