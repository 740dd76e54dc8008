"""The kernel: the only modules that import OCP, build123d and cadquery. Our records in, shapes and files out."""
