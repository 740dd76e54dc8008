"""Measured mirrors: files in, the report of what was made out."""
