"""The materials' names in, what a glTF file says of them out."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Material:
    """Base colour (linear sRGB), and metallic and roughness factors as glTF 2.0 defines them."""

    colour: tuple[float, float, float]
    metallic: float
    roughness: float


# "paint" is the material whose colour a scene may replace.
MATERIALS = {
    "paint": Material((0.42, 0.43, 0.45), 0.0, 0.10),
    "box": Material((0.72, 0.73, 0.72), 0.0, 0.50),
    "glass": Material((0.012, 0.015, 0.016), 0.0, 0.02),
    "seen-light": Material((0.052, 0.058, 0.062), 0.0, 0.02),  # what shows through a pane, as smooth as the pane
    "seen-dark": Material((0.022, 0.022, 0.023), 0.0, 0.02),
    "seen-person": Material((0.034, 0.028, 0.025), 0.0, 0.02),
    "tyre": Material((0.020, 0.020, 0.021), 0.0, 0.90),
    "rim": Material((0.42, 0.43, 0.44), 0.0, 0.35),
    "trim": Material((0.016, 0.016, 0.017), 0.0, 0.55),
    "gloss": Material((0.012, 0.012, 0.013), 0.0, 0.06),
    "lamp": Material((0.80, 0.82, 0.84), 0.0, 0.05),
    "tail-lamp": Material((0.34, 0.012, 0.012), 0.0, 0.08),
    "side-lamp": Material((0.72, 0.22, 0.01), 0.0, 0.10),
    "plate": Material((1.0, 1.0, 1.0), 0.0, 0.50),
    "chrome": Material((0.63, 0.64, 0.66), 1.0, 0.08),
    "steel": Material((0.40, 0.41, 0.42), 0.0, 0.55),
    "concrete": Material((0.36, 0.35, 0.33), 0.0, 0.95),
    "bark": Material((0.085, 0.065, 0.048), 0.0, 1.0),
    "leaf-1": Material((0.050, 0.095, 0.022), 0.0, 0.75),
    "leaf-2": Material((0.075, 0.125, 0.030), 0.0, 0.75),
    "leaf-3": Material((0.034, 0.068, 0.018), 0.0, 0.75),
}
