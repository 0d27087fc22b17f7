"""The command line: `reprobe`."""

import os

# The matrices here are small: threads within one product cost more than they bring, and the cores have other work. It
# is read when numpy is first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from daemon.cli.app import main

__all__ = ["main"]
