"""The command line: ``stillpoint``, or ``python -m stillpoint_slam``."""

import signal
import sys

from . import _native


def main() -> int:
    """Carries out the command line of this process, and returns the exit code."""
    # The command line listens to Ctrl-C itself, and before it does so the signal ends the process as it would end any other: Python's own handler
    # would only note it, and tell it as an exception when everything is over.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _native.main(["stillpoint", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
