"""Let `python -m daemon.cli` be the command."""

from daemon.cli import main

main()
