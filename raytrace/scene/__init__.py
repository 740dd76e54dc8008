"""What can be seen in a mirror: only what some ray can reach is modelled."""
