"""Mirrors on a vehicle in a lit world: pictures for both eyes, measures, and sheets that compare them."""
