def serve() -> int:
    """To come."""
    return 1
