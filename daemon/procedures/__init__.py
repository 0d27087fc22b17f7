"""Procedures: what one job of each kind does, step by step; `registry` lists them."""
