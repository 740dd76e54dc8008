"""A window on the desktop, and files for ParaView."""
