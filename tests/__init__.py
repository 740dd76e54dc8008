"""Facts about the project, one test each."""
