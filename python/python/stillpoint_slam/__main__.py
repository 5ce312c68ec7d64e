"""The command line: ``stillpoint``, or ``python -m stillpoint_slam``."""

import signal
import sys

from . import _native


def main() -> int:
    """Runs the command line of this process, and returns the exit code."""
    # The command line handles Ctrl-C itself; before it does, the signal should end the process as usual. Python's handler would only raise an
    # exception after the command line returns.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _native.main(["stillpoint", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
