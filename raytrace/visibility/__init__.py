"""Which part of the world a reflector shows, and where its image ends."""
