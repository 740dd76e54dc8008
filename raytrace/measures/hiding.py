"""What of the lane beside is in no view of a mirror in use."""

from __future__ import annotations

from functools import partial

from raytrace.measures.blind_zone import BlindZone, HiddenCar, blind_zone, hidden_car
from raytrace.measures.in_use import MM_PER_M, MirrorInUse, metres
from raytrace.measures.registry import Measure, register, register_family

GROUP = "Ground and blind zone"


def blind_zones_in_use(use: MirrorInUse) -> tuple[BlindZone, ...]:
    """`blind_zone` on the ground and at the height that the scene asks about."""
    there = use.on_vehicle
    return tuple(blind_zone(there.views.left, there.views.right, there.host, there.asked.lane, height, there.asked.direct_view)
                 for height in (0.0, there.asked.hidden_height))


def hidden_in_use(use: MirrorInUse) -> HiddenCar:
    """`hidden_car` in both zones."""
    return hidden_car(use.record(blind_zones_in_use), use.on_vehicle.asked.lane)


@register_family
def blind_zones(use: MirrorInUse) -> tuple[Measure, ...]:
    """Length and area of the lane beside that is in no view, on the ground and at the scene's height."""
    found = []
    for k, height in enumerate(() if use.vehicle is None else (0.0, use.vehicle.asked.hidden_height)):
        where = f"{height / 1e3:g} m high" if height else "on the ground"
        place = f"_at_{height / 1e3:g}_m".replace(".", "_") if height else ""
        found.append(Measure(
            f"blind_length{place}_m", f"lane beside in no view, {where}, length", "m", 2,
            "along the lane's middle: neither in the mirror, for either eye, nor before the limit of direct view",
            partial(_length, k), group=GROUP, better="less", at_least=partial(_endless, k)))
        found.append(Measure(
            f"blind_area{place}_m2", f"lane beside in no view, {where}, area", "m²", 2, "of the lane between its lines",
            partial(_area, k), group=GROUP, better="less", at_least=partial(_endless, k)))
    return tuple(found)


def _length(k: int, use: MirrorInUse) -> float | None:
    return metres(use.record(blind_zones_in_use)[k].length_mm)


def _area(k: int, use: MirrorInUse) -> float | None:
    return use.record(blind_zones_in_use)[k].area_mm2 / MM_PER_M**2


def _endless(k: int, use: MirrorInUse) -> bool:
    return use.record(blind_zones_in_use)[k].endless


register(Measure("hidden_car_longest_m", "longest car that hides", "m", 2, "1.8 m wide, wholly in no view at both heights",
                 lambda use: metres(use.record(hidden_in_use).longest_mm), group=GROUP, better="less"))
