"""Mirrors in; a window on the desktop and files for ParaView out."""
