"""The panel of a rule of the road: which rules and classes there are, and the rule's lines for the design at hand."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

from mirror_cad.errors import SpecError
from mirror_studio.json_types import Json
from mirror_studio.rules.schema import QUANTITIES, RULES, load_rule, rule_names
from mirror_studio.web.protocol import ViewSettings

if TYPE_CHECKING:
    from mirror_studio.web.engine import Designed

NAMES = (*RULES, "r46-04")  # what the panel offers: of each rule the edition that its name means, and the newer one of UN R46


def offered() -> list[dict[str, Json]]:
    """The rules of the panel, as JSON holds them."""
    found: list[dict[str, Json]] = []
    for name in NAMES:
        rule = load_rule(name)
        found.append({"name": name, "title": f"{rule.rule}, {rule.edition.split(' of ')[0]}", "classes": list(rule.classes),
                      "start": rule.default_class})
    return found


def check_offered(name: object) -> None:
    """Raises: SpecError for a rule that is none of the package's: the studio reads no files by their names."""
    if not isinstance(name, str) or (name.upper() not in RULES and name not in rule_names()):
        raise SpecError(f"rules.rule = {str(name)[:60]!r}: the studio knows {', '.join(NAMES)} and reads no files by their "
                        "names: hold it against this one with `mirror-cad rules`")


def ruled(one: Designed, look: ViewSettings, fine: bool) -> dict[str, Json]:
    """Hold a design against the rule that its specification names.

    Parameters
    ----------
    one : Designed
    look : ViewSettings
        On the road, the mirror is on its vehicle, and fields of vision are measured.
    fine : bool
        Whether the hand rests: fields take tenths of a second, and are left out before.

    Returns
    -------
    dict
        rule, edition, class, wording, and lines as the page shows them; no lines without a rule.

    Raises
    ------
    MirrorError
        For a rule, class or mirror that there cannot be.
    """
    # With the tracer, which the page's start does not wait for.
    from mirror_studio.rules.mounted import Mounted
    from mirror_studio.rules.of_spec import measured_of, rule_of_spec
    from mirror_studio.rules.sheet import row_of
    from mirror_studio.rules.verdicts import ON_VEHICLE, judged

    spec = one.mirror.spec
    named = rule_of_spec(spec)
    if named is None:
        return {"lines": []}
    on_road = look.view == "road"
    if on_road and fine:
        from mirror_studio.web.motorway import MountParameters, driven

        mirror = driven(one, MountParameters.of(look))
        measured = measured_of(spec, named, mirror.reflector, Mounted(mirror.pose, mirror.eyes, mirror.host))
    else:
        measured = measured_of(spec, named, one.reflector)
    only = None if measured.seen is not None else set(QUANTITIES) - set(ON_VEHICLE)
    rows: list[dict[str, Json]] = [{**asdict(row_of(line)), "quantity": line.asked.quantity}
                                   for line in judged(measured, named.class_name, only)]
    return {"rule": named.rule.rule, "edition": named.rule.edition, "class": named.class_name, "wording": named.rule.wording,
            "vehicle": measured.seen is not None, "pending": on_road and not fine,
            "lines": rows}

