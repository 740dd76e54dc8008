"""From two radius laws to a STEP file, and what the driver sees in the file that was written."""

import mirror_cad as mc
import raytrace as rt

WIDTH_PX = 640  # of the picture

spec = mc.MirrorSpec(name="mine", horizontal=mc.laws.Zones(right_mm=1250, left_mm=400, blend_from=0.59),
                     vertical=mc.laws.Linear(right_mm=1250, left_mm=1350))
mirror = mc.design(spec)
print(mirror)

mirror.export_step("mine.step")
view = rt.View(rt.load_reflector("mine.step"))  # the eye where the paper has it, 762 mm before the mirror
lane = rt.Lane(x0_mm=0.0, y0_mm=2400.0, slope=0.6)
bend = rt.measures.lane_straightness(view, lane).percent
print(f"the lane's image bends by {bend:.1f} %")

rt.driver_view(view, "road", WIDTH_PX).save("design_to_step.png")
