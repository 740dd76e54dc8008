"""A mirror that another program drew: a spherical cap made with build123d, seated, looked into, and measured."""

from build123d import Box, Pos, Sphere, export_step

import raytrace as rt

R, WIDTH, HEIGHT = 1000.0, 180.0, 120.0  # mm
WIDTH_PX = 480

# At vehicle coordinates, the sphere's top facing up: nothing in the file says that it is a mirror.
cap = Pos(300, 2000, 900) * (Sphere(R) & Pos(0, 0, R) * Box(WIDTH, HEIGHT, 50))
top = max(cap.faces(), key=lambda face: face.center().Z)
export_step(top, "cap.step")

reflector = rt.load_reflector("cap.step", place="face")  # mirror coordinates by the face's own frame
print(reflector.placement)
view = rt.View(reflector)
use = rt.MirrorInUse(view, rt.Lane(x0_mm=0.0, y0_mm=2400.0, slope=0.6))
field = rt.measures.registered()["h_fov_traced_deg"].value(use)
print(f"the horizontal field of view is {field:.2f}°")

rt.driver_view(view, "road", WIDTH_PX).save("own_step_traced.png")
