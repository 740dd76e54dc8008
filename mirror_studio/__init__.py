"""Where mirrors and traces meet people and files: the command line, the pipeline and its reports."""
