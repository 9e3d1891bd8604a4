def alarms() -> int:
    """To come."""
    return 1
