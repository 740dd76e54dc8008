"""A mirror cut to an outline of one's own: an ellipse of 160 × 110 mm drawn as SVG (DXF goes the same way)."""

from math import pi
from pathlib import Path

from matplotlib.figure import Figure

import mirror_cad as mc
from mirror_cad.spec import OutlineSpec

A, B = 80.0, 55.0  # mm, half the axes
Path("ellipse.svg").write_text(f"""<svg xmlns="http://www.w3.org/2000/svg" width="160mm" height="110mm"
    viewBox="-80 -55 160 110"><ellipse rx="{A}" ry="{B}"/></svg>""")

spec = mc.MirrorSpec(name="ellipse", horizontal=mc.laws.Constant(radius_mm=1200), vertical=mc.laws.Constant(radius_mm=1200),
                     outline=OutlineSpec(file="ellipse.svg"))
mirror = mc.design(spec)
mirror.export_step("ellipse.step")
area, flat = mirror.plate.area_mm2, pi * A * B  # a curved face is a little larger than the ellipse below it
print(f"{area:.1f} mm² of mirror over an ellipse of {flat:.1f} mm²")

outline = mirror.outline.polyline(0.01)
figure = Figure(figsize=(5, 3.6), layout="constrained")
axes = figure.add_subplot(aspect="equal", xlabel="x, mm", ylabel="y, mm", title="height of the mirror, mm")
x, y, z = mirror.grid_points(2.0)[:, :3].T
axes.tricontourf(x, y, z, levels=12)
axes.fill(*outline.T, facecolor="none", edgecolor="k")
figure.savefig("own_outline.png", dpi=110)
