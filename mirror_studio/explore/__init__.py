"""Many mirrors: studies over the keys of a specification, and the front of what is possible."""
