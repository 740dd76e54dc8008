"""How far the realised curvature is from the designed one: the figures of the written STEP file, and a map."""

from matplotlib.figure import Figure

import mirror_cad as mc

mirror = mc.design(mc.load_spec("progressive-c"))
deviation = mirror.deviation()  # writes STEP and STL to a temporary folder, reads them back, and compares
worst = deviation.total.k1.max_percent
x, y = deviation.total.k1.max_at_mm
print(f"k1 is off by {worst:+.2f} % at ({x:.0f}, {y:.0f}) mm; "
      f"of that the B-spline's fit is {abs(deviation.stages.fit.k1.max_percent):.3f} %")

figure = Figure(figsize=(4.4, 5.2), layout="constrained")
axes = figure.add_subplot(aspect="equal", xlabel="x, mm", ylabel="y, mm", title="k1, realised minus designed, %")
points = axes.scatter(deviation.grid.x, deviation.grid.y, c=deviation.percent.k1, s=2, cmap="RdBu_r", vmin=-5, vmax=5)
figure.colorbar(points)
figure.savefig("deviation_report.png", dpi=110)
