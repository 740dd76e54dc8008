"""Mirrors that numerics find hard: the cases, what they are compared with, and the processes that they run in."""
