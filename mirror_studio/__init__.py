"""Where mirrors and traces meet people and files: the command line, the pipeline and its reports."""

import raytrace  # noqa: F401  so that [limits] knows the measures of what a mirror shows
