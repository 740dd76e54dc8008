"""The built-in reference picture of the road: a scene made of formulas goes in, a JPEG file comes out."""
