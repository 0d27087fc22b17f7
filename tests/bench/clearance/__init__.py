"""Clearance bench: random places and corrections on boards with parts, and what the plant says was hit."""
