"""Rays and a mirror in, what each tracer makes of them out: ours and its peers, one a file."""
