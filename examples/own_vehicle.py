"""A vehicle of one's own: a van of 2.4 m that was drawn as a mesh, its mirror aimed, and what the driver's two eyes see."""

from pathlib import Path

import trimesh
from PIL import Image

from mirror_studio.drive.mirrors import driven_mirror
from mirror_studio.drive.pictures import World, both_eyes
from mirror_studio.scene_file import load_scene
from raytrace.measures.eye_fields import extent, eye_fields

EYE_PX = 320, 360  # of the picture of one eye

# The van as a mesh in mm: X rearward from its front, Y to the right, Z up.
trimesh.creation.box(bounds=[(0, -1200, 300), (4500, 1200, 2600)]).export("van.stl")
Path("van.toml").write_text("""
name = "van"
[mirror]
centre_m = [-0.54, -1.35, 1.76]
[own_vehicle]
width_m = 2.4
front_m = 0.0
rear_m = 4.5
height_m = 2.6
body = "van.stl"
[road]
left_m = -9.6
right_m = 4.6
[[road.line]]
y_m = -1.75
dash_m = 6.0
period_m = 18.0
[[vehicle]]
name = "behind"
body = "saloon"
paint = "#7d1414"
x_m = 14.0
y_m = -3.5
""")
scene = load_scene("van.toml")
mirror = driven_mirror("sphere-1250", scene)
print(mirror.pose)
field = extent(eye_fields(mirror.views, mirror.host).horizon_clear.either)
print(f"{field:.1f}° of the horizon are seen by either eye beside the van")

picture, _ = both_eyes(mirror, World(scene), width=EYE_PX[0], height=EYE_PX[1])
Image.fromarray(picture).save("own_vehicle.png")
