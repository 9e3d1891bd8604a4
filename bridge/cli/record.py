def record() -> int:
    """To come."""
    return 1
