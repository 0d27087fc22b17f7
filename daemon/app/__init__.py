"""The running daemon: built, started, supervised and stopped."""
