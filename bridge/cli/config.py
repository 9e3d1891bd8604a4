"""`tcbridge config show`: every setting, and where its value came from."""

from bridge.cli.exits import Exit
from bridge.cli.options import COMMON, Common
from bridge.cli.show import print_settings


def show(*, common: Common = COMMON) -> int:
    """Show every setting, its value and where it came from.

    An option beats the environment, the environment beats the file, the file
    beats the default. What is misspelled is refused with the nearest name.

    Try:
        tcbridge config show
        tcbridge config show --settings line1.toml --json
    """
    print_settings(common.loaded(), as_json=common.json)
    return Exit.OK
