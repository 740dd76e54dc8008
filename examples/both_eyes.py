"""A mirror aimed on a vehicle, seen by both eyes: where they are shown different sizes."""

import numpy as np
from matplotlib.figure import Figure

import mirror_cad as mc
import raytrace as rt
from raytrace.measures.disparity import disparity

reflector = rt.Reflector.from_mirror(mc.design(mc.load_spec("progressive-c")))
eyes = rt.Eyes(middle=np.array([0.0, -490.0, 1900.0]))  # X rearward, Y right, Z up; 65 mm apart
truck = rt.HostVehicle(half_width_mm=870.0, front_mm=-200.0, rear_mm=3900.0, height_mm=2450.0)
mounted = rt.Pose(centre=np.array([-540.0, -1010.0, 1760.0]), pivot=np.array([0.0, 0.0, -40.0]))
# So that the truck's flank takes 12 % of the width, and the horizon lies at 60 % of the height.
pose = rt.aimed(reflector, mounted, eyes.middle, truck.rear_edge("left"), rt.Aim(flank=0.12, horizon=0.6))
print(pose)

found = disparity(rt.EyeViews.of(reflector, pose, eyes))
print(f"the largest disparity is {found.max_percent:.1f} % at ({found.max_at_mm[0]:.0f}, {found.max_at_mm[1]:.0f}) mm")

figure = Figure(figsize=(4.6, 5.2), layout="constrained")
axes = figure.add_subplot(aspect="equal", xlabel="x, mm", ylabel="y, mm", title="left eye's size over the right eye's, %")
figure.colorbar(axes.pcolormesh(found.x, found.y, found.percent, cmap="RdBu_r", vmin=-16, vmax=16))
figure.savefig("both_eyes.png", dpi=110)
