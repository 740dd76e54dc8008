"""Tolerances before anything is made: many mirrors as they may come out, and which tolerance costs what."""
