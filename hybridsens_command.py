"""Entry point of the `hybridsens` command, beside the package: importing that takes seconds, and Ctrl-C may come."""

import os
import signal
import sys
from importlib import import_module


def main() -> None:
    """Import the command line and run it. Until it takes Ctrl-C into its own hands, that ends all with one line."""
    listening = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # a job in the background ignores Ctrl-C
    if listening:
        signal.signal(signal.SIGINT, _leave)
    command = import_module("hybridsens.cli.main")
    if listening:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    command.main()


def _leave(*_) -> None:
    print("hybridsens: interrupted", file=sys.stderr, flush=True)
    os._exit(128 + signal.SIGINT)  # an exception would be swallowed by one import or another
