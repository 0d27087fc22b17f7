"""Let `python -m daemon.cli` be the command."""

from daemon.cli.app import main

main()
