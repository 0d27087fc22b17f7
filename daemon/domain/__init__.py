"""States, errors, roles, the board, results: no I/O."""
