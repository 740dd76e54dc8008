"""The outer radius from 300 to 600 mm: how the field of view is bought with a bent lane."""

import numpy as np
from matplotlib.figure import Figure

import mirror_cad as mc
import raytrace as rt

COUNT = 7
radii = np.linspace(300.0, 600.0, COUNT)
lane = rt.Lane(x0_mm=0.0, y0_mm=2400.0, slope=0.6)
fields, bends = [], []
for left_mm in radii:
    spec = mc.MirrorSpec(horizontal=mc.laws.Zones(right_mm=1250, left_mm=left_mm, blend_from=0.59),
                         vertical=mc.laws.Constant(radius_mm=1250))
    mirror = mc.design(spec)
    view = rt.View(rt.Reflector.from_mirror(mirror))  # the designed surface; a written file is traced in design_to_step.py
    use = rt.MirrorInUse(view, lane, mirror.box, mirror.left_height_mm)
    fields.append(rt.measures.registered()["h_fov_traced_deg"].value(use))
    bends.append(rt.measures.lane_straightness(view, lane).percent)
    print(f"{left_mm:5.0f} mm: {fields[-1]:5.2f}°, {bends[-1]:5.2f} %")

figure = Figure(figsize=(5, 3.4), layout="constrained")
axes = figure.add_subplot(xlabel="lane straightness, % (0 is straight)", ylabel="horizontal field of view, °")
axes.plot(bends, fields, "o-")
axes.margins(0.12)
for left_mm, bend, field in zip(radii, bends, fields, strict=True):
    axes.annotate(f"{left_mm:.0f} mm", (bend, field), xytext=(6, -10), textcoords="offset points")
figure.savefig("sweep_of_a_radius.png", dpi=110)
