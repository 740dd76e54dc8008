"""Figures by which mirrors are compared, one measure a file, each defined in its docstring and traced exactly."""
