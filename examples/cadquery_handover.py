"""The mirror handed over to cadquery: a hole for the wire of the heater, drilled through the plate."""

from math import pi

import cadquery as cq

import mirror_cad as mc

DIAMETER = 6.0  # mm

mirror = mc.design(mc.load_spec("flat"))
plate = mirror.to_cadquery()
drilled = plate.cut(cq.Workplane("XY", origin=(40, -60, -20)).circle(DIAMETER / 2).extrude(40))
removed = plate.val().Volume() - drilled.val().Volume()
expected = pi * DIAMETER**2 / 4 * mirror.spec.glass.thickness_mm
print(f"{removed:.3f} mm³ drilled away; of a flat plate that is {expected:.3f} mm³")

cq.exporters.export(drilled, "drilled.step")
cq.exporters.export(drilled, "cadquery_handover.svg", opt={"projectionDir": (0.4, 0.3, 1.0), "showAxes": False})
