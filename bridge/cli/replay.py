def replay() -> int:
    """To come."""
    return 1
