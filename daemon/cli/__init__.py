"""The command line: `reprobe`."""

import gc
import os
import sys

from daemon.platform.early_hangup import remember
from daemon.platform.streams import open_streams

# The matrices here are small: threads within one product cost more than they bring, and the cores have other work. It
# is read when numpy is first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def main() -> None:
    """Run the command line. The daemon is loaded without the other commands, whose libraries it need not carry."""
    open_streams()
    words = sys.argv[1:]
    if words[:1] == ["serve"] or _called_as_before(words):
        remember()
        # What is loaded stays: looking for garbage among it costs a tenth of a second here, and some later
        gc.disable()
        from daemon.cli.last_resort import with_words  # noqa: PLC0415  # the daemon starts without the other commands
        from daemon.cli.serve import app as alone  # noqa: PLC0415  # as above

        gc.freeze()
        gc.enable()
        sys.argv[1] = "serve"
        with_words(alone)
        alone()
    else:
        from daemon.cli.app import main as whole  # noqa: PLC0415  # as above

        whole()


def _called_as_before(words: list[str]) -> bool:
    """Tell whether the daemon is meant by its old name, `reprobe run --config station.toml`, and by nothing else."""
    rest = [word for word in words[1:] if word != "--json"]
    named = len(rest) == 2 and rest[0] in ("--config", "-c")  # the option and its value
    return words[:1] == ["run"] and (named or (len(rest) == 1 and rest[0].startswith("--config=")))
