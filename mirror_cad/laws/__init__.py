"""Curvature laws: how a radius, or a curvature, runs along the horizontal of a mirror; one law a file."""

from mirror_cad.laws.base import Law
from mirror_cad.laws.constant import Constant
from mirror_cad.laws.curvature import Break, CurvatureLaw, Span
from mirror_cad.laws.expression import Expression
from mirror_cad.laws.linear import Linear
from mirror_cad.laws.matched import Match, Matched
from mirror_cad.laws.power import Power
from mirror_cad.laws.registry import register, registered, unregister
from mirror_cad.laws.table import Table
from mirror_cad.laws.two_radii import TwoRadii
from mirror_cad.laws.unstated import Unstated
from mirror_cad.laws.zones import Zones

__all__ = ["Break", "Constant", "CurvatureLaw", "Expression", "Law", "Linear", "Match", "Matched", "Power", "Span", "Table",
           "TwoRadii", "Unstated", "Zones", "register", "registered", "unregister"]
