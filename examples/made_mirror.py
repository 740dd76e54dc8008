"""A made mirror: measured points laid on the design, and what its curvature deviates by, with the uncertainty."""

import numpy as np
from matplotlib.figure import Figure

import mirror_cad as mc
from mirror_cad.made.inspection import inspect
from mirror_cad.made.nominal import Nominal

mirror = mc.design(mc.load_spec("progressive-c"))
nominal = Nominal(mirror.surface, mirror.outline)

# What a measuring machine would give: 5 µm of noise, the mirror turned by 30°, and glass that did not reach its mould.
rng = np.random.default_rng(1)
points = mirror.grid_points(5.0)[:, :3]
x, y = points[:, 0], points[:, 1]
points[:, 2] += 0.08 * np.exp(-((x - 40.0) ** 2 + (y - 60.0) ** 2) / 45.0**2) + rng.normal(0.0, 0.005, len(points))
c, s = np.cos(np.radians(30.0)), np.sin(np.radians(30.0))
points = points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + [600.0, -700.0, 400.0]

found = inspect(nominal, points, gauge_mm=38.0)
fields = found.fields
kx, sigma = (np.where(fields.known, each, np.nan) for each in fields.percent("kx"))  # where the whole gauge stands
worst = int(np.nanargmax(np.abs(kx)))
x_worst, y_worst = fields.lattice.places[worst]
print(f"{found.used.sum()} points with a sigma of {1e3 * found.sigma_mm:.1f} µm; kx is off by {kx[worst]:+.1f} ± "
      f"{sigma[worst]:.1f} % at ({x_worst:.0f}, {y_worst:.0f}) mm")

figure = Figure(figsize=(9.0, 4.4), layout="constrained")
panels = figure.subplots(1, 3, sharey=True)
for axes, values, title, colours, largest in zip(
        panels, (1e3 * fields.height, kx, sigma), ("height, µm", "kx over 38 mm, %", "sigma of kx, %"),
        ("RdBu_r", "RdBu_r", "viridis"), (80.0, 10.0, 2.5), strict=True):
    low = -largest if colours == "RdBu_r" else 0.0
    drawn = axes.imshow(fields.lattice.as_map(values).T, origin="lower", extent=nominal.box, cmap=colours, vmin=low,
                        vmax=largest)
    axes.set(title=title, xlabel="x, mm")
    figure.colorbar(drawn, shrink=0.8)
panels[0].set_ylabel("y, mm")
figure.savefig("made_mirror.png", dpi=110)
