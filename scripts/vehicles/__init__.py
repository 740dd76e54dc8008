"""Vehicles and roadside objects of the driver's world: a few named dimensions go in, GLB files come out.

Modelling is in mm in the directions of ISO 4130: X rearward, Y right, Z up; a vehicle's front end lies at X = 0, its median
plane at Y = 0, the ground at Z = 0. ``export.py`` says what the files hold.
"""
