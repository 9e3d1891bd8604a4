def create() -> int:
    """To come."""
    return 1


def raise_() -> int:
    """To come."""
    return 1


def clear() -> int:
    """To come."""
    return 1


def confirm() -> int:
    """To come."""
    return 1


def dispose() -> int:
    """To come."""
    return 1
