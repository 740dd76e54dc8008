"""Speed against error: parts that each measure one thing beside its peers, and the command that runs and shows them."""
