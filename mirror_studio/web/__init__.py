"""The studio: a page on which a mirror is designed by hand, and the server behind it."""
