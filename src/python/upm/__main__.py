"""The command `upm`, also as `python -m upm`."""

import sys

from upm._upm import main as _main


def main() -> int:
    """Runs the command line and returns its exit status."""
    return _main(["upm", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
