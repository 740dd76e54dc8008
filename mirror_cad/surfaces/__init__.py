"""The mirror's surface as geometry: B-splines, how they are found, and what their curvature is."""
