"""Materials: the name of a material goes in, its albedo (linear RGB) comes out."""

from __future__ import annotations

import numpy as np

YELLOW_PAINT = np.array([0.84, 0.48, 0.008])
WHITE_PAINT = np.array([0.74, 0.74, 0.72])
ASPHALT = np.array([0.150, 0.149, 0.150])
GRAVEL = np.array([0.25, 0.24, 0.225])
GRASS = np.array([0.070, 0.150, 0.028])
LEAF_DARK, LEAF_LIGHT = np.array([0.034, 0.090, 0.020]), np.array([0.085, 0.170, 0.042])
LEAF_SHADE = np.array([0.012, 0.030, 0.008])
CAST_IRON = np.array([0.060, 0.058, 0.056])
CONCRETE = np.array([0.33, 0.33, 0.325])
GALVANISED = np.array([0.40, 0.42, 0.44])
GREEN_PAINT, RED_PAINT = np.array([0.010, 0.205, 0.036]), np.array([0.400, 0.012, 0.040])
BLUE_PAINT, CAB_PAINT = np.array([0.020, 0.060, 0.210]), np.array([0.030, 0.085, 0.260])
RUBBER = np.array([0.018, 0.018, 0.019])
BLACK_TRIM = np.array([0.020, 0.020, 0.021])
# Behind glass, as light that reaches the windscreen:
SEAT_FABRIC = np.array([0.026, 0.026, 0.028])
DRIVER_CLOTHES = np.array([0.012, 0.014, 0.020])
DRIVER_SKIN = np.array([0.038, 0.026, 0.021])
