"""Our tracer and its peers, one a file."""
