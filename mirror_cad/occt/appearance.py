"""The colours and layers that a document gives its shapes."""

from __future__ import annotations

from OCP.Quantity import Quantity_Color, Quantity_TOC_sRGB
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDF import TDF_ChildIterator, TDF_Label, TDF_LabelSequence
from OCP.TDocStd import TDocStd_Document
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS_Shape
from OCP.XCAFDoc import XCAFDoc_ColorGen, XCAFDoc_ColorSurf, XCAFDoc_ColorTool, XCAFDoc_DocumentTool, XCAFDoc_ShapeTool

from mirror_cad.occt.shapes import anywhere

Colour = tuple[int, int, int]


class Appearance:
    """What colours and layers the shapes of a document have.

    The kernel looks for a shape through all labels of a document. It is asked for those only that a label with a colour or a
    layer names, or the time would grow with the square of the number of faces.
    """

    def __init__(self, document: TDocStd_Document) -> None:
        self._colours = XCAFDoc_DocumentTool.ColorTool_s(document.Main())
        self._layers = XCAFDoc_DocumentTool.LayerTool_s(document.Main())
        self._coloured: set[int] = set()
        self._layered: set[int] = set()
        labels = TDF_ChildIterator(XCAFDoc_DocumentTool.ShapeTool_s(document.Main()).Label(), True)
        while labels.More():
            label = labels.Value()
            for having, has in ((self._coloured, _label_colour(label) is not None),
                                (self._layered, self._layers.GetLayers(label, TDF_LabelSequence()))):
                if has:
                    having.add(anywhere(XCAFDoc_ShapeTool.GetShape_s(label)))
            labels.Next()

    def colour(self, shapes: list[TopoDS_Shape], above: tuple[TDF_Label, ...]) -> Colour | None:
        """Of the first of the shapes that has one, else of the nearest label above that has."""
        found = (self._colour_of(each) for each in shapes if anywhere(each) in self._coloured)
        first = next((colour for colour in found if colour is not None), None)
        return first or next((c for c in (_label_colour(each) for each in reversed(above)) if c is not None), None)

    def layers(self, shapes: list[TopoDS_Shape], above: tuple[TDF_Label, ...]) -> tuple[str, ...]:
        """Names of the layers that a face, its solid or a part above it lies on."""
        found: dict[str, None] = {}
        named = [each for each in shapes if anywhere(each) in self._layered]
        for each in (*(placed for shape in named for placed in (shape, shape.Located(TopLoc_Location()))), *above):
            labels = TDF_LabelSequence()
            if self._layers.GetLayers(each, labels):
                for k in range(1, labels.Length() + 1):
                    name = TCollection_ExtendedString()
                    if self._layers.GetLayer(labels.Value(k), name):
                        found[str(name.ToExtString())] = None
        return tuple(found)

    def _colour_of(self, shape: TopoDS_Shape) -> Colour | None:
        """Of a shape where it is placed, or of the part that is placed there."""
        colour = Quantity_Color()
        for placed in (shape, shape.Located(TopLoc_Location())):
            for kind in (XCAFDoc_ColorSurf, XCAFDoc_ColorGen):
                if self._colours.GetColor(placed, kind, colour):
                    return _rgb(colour)
        return None


def _rgb(colour: Quantity_Color) -> Colour:
    red, green, blue = (round(255 * float(value)) for value in colour.Values(Quantity_TOC_sRGB))
    return red, green, blue


def _label_colour(label: TDF_Label) -> Colour | None:
    colour = Quantity_Color()
    for kind in (XCAFDoc_ColorSurf, XCAFDoc_ColorGen):
        if XCAFDoc_ColorTool.GetColor_s(label, kind, colour):
            return _rgb(colour)
    return None
