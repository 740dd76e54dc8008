"""Tolerances before anything is made: how far field of view and lane spread, and which tolerance brings how much of it."""

from pathlib import Path

from matplotlib.figure import Figure

from mirror_studio.tolerances.file import load_tolerances
from mirror_studio.tolerances.made import evaluate_made
from mirror_studio.tolerances.statistics import outcomes

SAMPLES = 64  # a power of two; SAMPLES × (tolerances + 2) mirrors are made

Path("glass.toml").write_text(f"""
spec = "progressive-c"
measures = ["h_fov_traced_deg", "lane_straightness_percent"]
samples = {SAMPLES}
[keys]
"horizontal.right_mm" = {{ sigma = 8.0, also = ["vertical.right_mm"] }}
"horizontal.left_mm" = {{ sigma = 5.0 }}
[form.bending]
map = "random"
rms_mm = 0.005
wavelength_mm = 80.0
""", encoding="utf-8")
study = load_tolerances(Path("glass.toml"))
# `mirror-cad tolerances glass.toml` does the same on all cores, and goes on where it was stopped.
designed = evaluate_made(0, (), study.as_designed(), ".", None, study.measures)
rows = [evaluate_made(k, values, study.with_values(values), ".", None, study.measures)
        for k, values in enumerate(study.mirrors())]
found = outcomes(study, designed, rows).by_measure

figure = Figure(figsize=(9.0, 5.0), layout="constrained")
for (name, one), (histogram, bars) in zip(found.items(), figure.subplots(2, 2), strict=True):
    low, high = one.interval
    print(f"{name}: designed {one.designed:.2f}, 95 % of the mirrors have {low:.2f} to {high:.2f}")
    histogram.hist(one.values, bins=24, color="#9cc7e0")
    histogram.axvline(one.designed, color="black")
    for end in one.interval:
        histogram.axvline(end, color="black", linestyle="--", linewidth=1.0)
    histogram.set(xlabel=name, ylabel="mirrors")
    bars.barh(list(one.indices), [index.total for index in one.indices.values()], color="#0072b2")
    bars.set(xlabel="share of the variance", xlim=(0.0, 1.05))
figure.savefig("glass_tolerances.png", dpi=110)
