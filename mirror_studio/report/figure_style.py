"""How the figures that matplotlib draws look: size, type, and the scale of deviations."""

from __future__ import annotations

from typing import Any

from matplotlib.colors import LinearSegmentedColormap

from mirror_studio.report.colours import BLUE_ORANGE

DPI = 150
WIDTH_IN = 10.4
DIVERGING = LinearSegmentedColormap.from_list("blue-orange", list(BLUE_ORANGE))
STYLE: dict[str, Any] = {
    "font.size": 9.0, "axes.titlesize": 9.5, "axes.linewidth": 0.6, "axes.edgecolor": "#666666",
    "xtick.color": "#444444", "ytick.color": "#444444", "axes.labelcolor": "#444444", "text.color": "#222222",
    "xtick.major.width": 0.6, "ytick.major.width": 0.6, "legend.frameon": False, "svg.hashsalt": "mirror-cad",
}
