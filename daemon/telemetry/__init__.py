"""What can be seen from outside: metrics, vitals, the status line."""
