def demo() -> int:
    """To come."""
    return 1
