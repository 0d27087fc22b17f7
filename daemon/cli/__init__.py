"""The command line: `reprobe`."""

import os
import sys

# The matrices here are small: threads within one product cost more than they bring, and the cores have other work. It
# is read when numpy is first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def main() -> None:
    """Run the command line. The daemon is loaded without the other commands, whose libraries it need not carry."""
    if sys.argv[1:2] == ["run"]:
        from daemon.cli.serve import app as alone  # noqa: PLC0415

        alone()
    else:
        from daemon.cli.app import main as whole  # noqa: PLC0415

        whole()
