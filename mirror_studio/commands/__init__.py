"""The commands of `mirror-cad`. Nothing heavy is imported before one of them runs."""
