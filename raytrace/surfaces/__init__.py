"""What rays meet: one kind of optical surface a file."""
