"""Made mirrors: measured points to the surface they tell of, its curvature, and how sure that is."""
