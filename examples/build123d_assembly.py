"""The mirror in a build123d assembly: glass before a housing, one STEP file, one drawing."""

from build123d import Box, Compound, ExportSVG, LineType, Part, Pos, export_step, fillet

import mirror_cad as mc

mirror = mc.design(mc.load_spec("sphere-1250"))
glass = mirror.to_build123d()
print(f"{glass.label}: {glass.volume / 1000:.1f} cm³, valid: {glass.is_valid}")

block = Pos(0, 0, -60) * Box(260, 380, 80)
housing = Part(fillet(block.edges(), 18).wrapped, label="housing")
clearance = (glass & housing).volume if glass.intersect(housing) else 0.0
print(f"glass and housing share {clearance:.1f} mm³")

assembly = Compound(label="door mirror", children=[glass, housing])
export_step(assembly, "door-mirror.step")

visible, hidden = assembly.project_to_viewport((500, 300, 900), viewport_up=(0, 1, 0))
drawing = ExportSVG(margin=5)
drawing.add_layer("visible", line_weight=0.5)
drawing.add_layer("hidden", line_weight=0.15, line_type=LineType.ISO_DASH_SPACE)
drawing.add_shape(visible, layer="visible")
drawing.add_shape(hidden, layer="hidden")
drawing.write("build123d_assembly.svg")
