"""To come."""


def publisher() -> int:
    """To come."""
    return 1
