"""From a specification to the finished set of files of one mirror, or of the paper's six."""
