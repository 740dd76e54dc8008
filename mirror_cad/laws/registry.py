"""Which laws there are. A new one is a file beside this one and its name below, or `register` from outside."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TypeVar

from mirror_cad.laws.base import Law
from mirror_cad.laws.constant import Constant
from mirror_cad.laws.expression import Expression
from mirror_cad.laws.linear import Linear
from mirror_cad.laws.power import Power
from mirror_cad.laws.table import Table
from mirror_cad.laws.zones import Zones

BUILT_IN: tuple[type[Law], ...] = (Constant, Linear, Power, Zones, Table, Expression)

Kind = TypeVar("Kind", bound=Law)


def register(law: type[Kind]) -> type[Kind]:
    """Make a law known by its name, as a decorator or a call: specifications, reports and the studio's page then have it.

    Parameters
    ----------
    law : type
        A subclass of `Law` whose key `law` has its name as default.

    Returns
    -------
    type
        The same class.

    Raises
    ------
    ValueError
        For a class without a name, or a name that another law has.
    """
    name = law.model_fields["law"].default
    if not isinstance(name, str) or not name:
        raise ValueError(f"{law.__name__} has no name: give it the key `law: Literal[\"its-name\"] = \"its-name\"`")
    if Law.known.get(name, law) is not law:
        raise ValueError(f"{law.__name__}: the name {name!r} is that of the law {Law.known[name].__name__}")
    Law.known[name] = law
    return law


def unregister(law: type[Law]) -> None:
    """Make a law unknown again; one that is not known is left alone."""
    name = law.model_fields["law"].default
    if Law.known.get(name) is law:
        del Law.known[name]


def registered() -> Mapping[str, type[Law]]:
    """Return the laws by their names, in the order in which they are offered."""
    return MappingProxyType(Law.known)


for _law in BUILT_IN:
    register(_law)
