"""The computer below: files, processes, logs, clock, memory, the service manager."""
