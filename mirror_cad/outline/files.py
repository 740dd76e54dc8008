"""Read a mirror's outline from a DXF or SVG file, chaining its pieces into one closed loop."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from mirror_cad.errors import OutlineError
from mirror_cad.outline.dxf import dxf_pieces, write_dxf
from mirror_cad.outline.numbers import Point, point_text
from mirror_cad.outline.options import AS_DRAWN, FILE_JOIN_TOLERANCE_MM, JOIN_MM, LARGEST_JOIN_MM, FileOptions, OutlineFile
from mirror_cad.outline.pieces import Piece
from mirror_cad.outline.record import Outline, closed_outline
from mirror_cad.outline.segments import Line, Segment, Spline
from mirror_cad.outline.svg import svg_pieces

__all__ = [
    "FILE_JOIN_TOLERANCE_MM",
    "MAXIMUM_FILE_BYTES",
    "MAXIMUM_SEGMENTS",
    "FileOptions",
    "OutlineFile",
    "open_outline",
    "read_outline",
    "write_dxf",
]

MAXIMUM_FILE_BYTES = 20_000_000
MAXIMUM_SEGMENTS = 20_000
"""Most segments in a file, every knot span of a spline counted as one."""


def read_outline(path: str | os.PathLike[str], options: FileOptions = AS_DRAWN) -> Outline:
    """The outline in a .dxf or .svg file, in mirror coordinates (mm, x right, y up); nothing is recentred.

    The pieces may be drawn in any order and direction. Ends within 1e-3 mm of each other are joined exactly; pieces
    whose two ends are joined that way and that are no larger themselves draw nothing and are dropped. Two ends that are
    then still loose, and each the nearest to the other within `options.join_mm`, are joined too. What is left must be one
    closed loop, or with `options.loop` = "outermost" one that holds all others.

    DXF: lengths are in the drawing's $INSUNITS (0, no unit, is mm). LINE, ARC, CIRCLE, ELLIPSE, LWPOLYLINE, POLYLINE (2D
    and 3D, with bulges) and SPLINE (polynomial or rational, clamped or not) entities of the model space count, those of
    inserted blocks too, in one plane of constant z with the extrusion direction (0, 0, 1) or (0, 0, -1), unless their
    layer is off, frozen or never plotted; with `options.layer` those of that layer, hidden or not. An arc of a polyline
    that rises less than 1e-6 mm is read as a line. Texts, dimensions, points and leaders are annotations and ignored, as
    is the paper space; endless lines, fillings and pictures are left out. Any other entity is an error. A damaged file is
    repaired where that can be done.

    SVG: the user origin of the outermost svg element is the mirror's origin and y_mirror = -y_svg, so a centred
    outline has a viewBox with a negative corner. With a physical width or height (mm, cm, in, pt, pc, Q, or px at 96
    to the inch), lengths are scaled as viewBox and preserveAspectRatio say (without viewBox a user unit is a px), but
    the viewport's position does not matter. Without one a user unit is 1 mm. path, rect, circle, ellipse, line,
    polyline and polygon count, inside g, a, switch and use and with all transforms; what is in defs, has display none or
    is hidden is not drawn and ignored, as are text, metadata and elements of other namespaces; with `options.layer` what is
    in the element of that id or Inkscape label counts. A clip path that is a rectangle around what it clips, as an
    artboard's is, cuts nothing. Any other element (image, a nested svg, ...), other clips, masks and geometry set by CSS
    are errors, as is a document type that declares entities.

    Circular arcs become `Arc`, elliptic ones exact rational `Spline`, Bezier curves `Spline`.

    Parameters
    ----------
    path : str or path
        Of the file.
    options : FileOptions
        Which layer counts, which loose ends are joined, which loop is taken.

    Raises
    ------
    OutlineError
        Naming file, entity, point and numbers, for a file that is missing, empty, larger than 20 MB, not DXF or SVG, damaged
        beyond repair, or has more than 20 000 segments; an unknown unit or layer; no geometry; an open outline; several loops;
        and whatever `mirror_cad.outline.closed_outline` refuses.
    """
    return open_outline(path, options).outline


def open_outline(path: str | os.PathLike[str], options: FileOptions = AS_DRAWN) -> OutlineFile:
    """`read_outline`, with notes on what was left out, joined or repaired."""
    file = Path(path)
    readers: dict[str, Callable[[Path, str | None, list[str]], Iterator[Piece]]] = {".dxf": dxf_pieces, ".svg": svg_pieces}
    reader = readers.get(file.suffix.lower())
    if reader is None:
        raise OutlineError(f"{file}: an outline file must end in .dxf or .svg, not {file.suffix!r}")
    if not FILE_JOIN_TOLERANCE_MM <= options.join_mm <= LARGEST_JOIN_MM:
        raise OutlineError(f"join_mm is {options.join_mm:g}: it must be from {FILE_JOIN_TOLERANCE_MM:g} to {LARGEST_JOIN_MM:g}")
    notes: list[str] = []
    try:
        size = file.stat().st_size
        if not file.is_file():
            raise OutlineError(f"{file}: not a file; give the path of a .dxf or .svg file")
        if size == 0:
            raise OutlineError(f"{file}: the file is empty (0 bytes); export the outline again")
        if size > MAXIMUM_FILE_BYTES:
            raise OutlineError(
                f"{file}: the file has {size} bytes, more than {MAXIMUM_FILE_BYTES}; export the outline alone"
            )
        pieces: list[Piece] = []
        total = 0
        for piece in reader(file, options.layer, notes):
            pieces.append(piece)
            segment = piece.segment
            total += len(np.unique(segment.knots)) - 1 if isinstance(segment, Spline) else 1
            if total > MAXIMUM_SEGMENTS:
                raise OutlineError(
                    f"{file}: more than {MAXIMUM_SEGMENTS} segments; export the outline alone, as few smooth curves"
                )
    except OSError as error:
        raise OutlineError(f"{file}: cannot be read: {error.strerror or error}") from None
    try:
        return OutlineFile(_chained(pieces, file, options, notes), tuple(notes))
    except OutlineError as error:
        left = [note for note in notes if "left out" in note]
        raise OutlineError("; ".join([str(error), *left])) from None


def _nodes(pieces: list[Piece], source: str) -> NDArray[np.int64]:
    """The number of the common point each piece starts and ends at, (n, 2): ends within tolerance share one."""
    ends = np.array([[piece.segment.start, piece.segment.end] for piece in pieces]).reshape(-1, 2)
    points, index = np.unique(ends, axis=0, return_inverse=True)
    tree = cKDTree(points)
    # Each end should have one neighbour; a crowd would make the list of pairs grow with its square.
    if tree.count_neighbors(tree, FILE_JOIN_TOLERANCE_MM) > 50 * len(points):
        raise OutlineError(
            f"{source}: too many ends of pieces lie within {FILE_JOIN_TOLERANCE_MM:g} mm of each other; check the "
            "drawing's units and delete the small pieces"
        )
    first, second = tree.query_pairs(FILE_JOIN_TOLERANCE_MM, output_type="ndarray").T
    links = coo_matrix((np.ones(len(first), dtype=bool), (first, second)), shape=(len(points), len(points)))
    labels = connected_components(links, directed=False)[1]
    return np.array(labels[index.ravel()].reshape(-1, 2), dtype=np.int64)


def _extent(segments: Iterable[Segment]) -> tuple[float, float, float, float]:
    boxes = np.array([segment.bounds() for segment in segments])
    return boxes[:, 0].min(), boxes[:, 1].max(), boxes[:, 2].min(), boxes[:, 3].max()


def _join_loose_ends(pieces: list[Piece], node: NDArray[np.int64], join_mm: float) -> list[tuple[float, Point]]:
    """Give ends that are loose, and each the other's nearest within join_mm, one number in `node`; the gaps and where."""
    numbers, counts = np.unique(node, return_counts=True)
    loose = [(i, side) for i, side in np.argwhere(np.isin(node, numbers[counts == 1])).tolist()]
    if len(loose) < 2 or join_mm <= FILE_JOIN_TOLERANCE_MM:
        return []
    ends = np.array([pieces[i].segment.end if side else pieces[i].segment.start for i, side in loose])
    near = cKDTree(ends).query_ball_point(ends, join_mm)
    joined: list[tuple[float, Point]] = []
    for k, others in enumerate(near):
        if len(others) != 2:
            continue  # nothing near, or more than one: which belong together is not clear
        other = others[0] if others[1] == k else others[1]
        (i, side), (j, far) = loose[k], loose[other]
        stray = i == j and isinstance(pieces[i].segment, Line)  # a line shorter than the gap, not a loop
        if k < other and len(near[other]) == 2 and not stray:
            node[j, far] = node[i, side]
            joined.append((math.dist(ends[k], ends[other]), (float(ends[k][0]), float(ends[k][1]))))
    return joined


def _chained(pieces: list[Piece], file: Path, options: FileOptions, notes: list[str]) -> Outline:
    """The outline that the pieces make, chained head to tail."""
    source = str(file)
    if not pieces:
        raise OutlineError(f"{source}: no outline found: the file has no lines, arcs or curves; draw one closed loop")
    node = _nodes(pieces, source)
    joined = _join_loose_ends(pieces, node, options.join_mm)
    if joined:
        widest, where = max(joined)
        notes.append(f"{file.name}: {len(joined)} gap{'s' * (len(joined) != 1)} of up to {widest:.3g} mm "
                     f"{'were' if len(joined) > 1 else 'was'} closed (the widest at {point_text(where)}); outline.join_mm says "
                     "how wide a gap may be")
    chains: list[list[Piece]] = []
    at_node: dict[int, list[int]] = {}
    for i, (piece, (start, end)) in enumerate(zip(pieces, node.tolist(), strict=True)):
        if start != end:
            at_node.setdefault(start, []).append(i)
            at_node.setdefault(end, []).append(i)
            continue
        x_min, x_max, y_min, y_max = piece.segment.bounds()
        if not isinstance(piece.segment, Line) and max(x_max - x_min, y_max - y_min) > 2.0 * FILE_JOIN_TOLERANCE_MM:
            chains.append([piece])
    closed = len(chains)
    for number, here in at_node.items():
        if len(here) > 2:
            i = here[0]
            where = pieces[i].segment.start if node[i, 0] == number else pieces[i].segment.end
            raise OutlineError(
                f"{source}: {len(here)} pieces end at {point_text(where)}: "
                f"{', '.join(pieces[k].label for k in here[:4])}{', ...' if len(here) > 4 else ''}; an outline does "
                "not branch, so delete duplicates and construction lines"
            )
    used = np.zeros(len(pieces), dtype=bool)
    # Open chains first, from their ends; whatever is left then closes on itself.
    loose = [number for number, here in at_node.items() if len(here) == 1]
    for number in [*loose, *at_node]:
        chain: list[Piece] = []
        at = number
        while True:
            ahead = [i for i in at_node[at] if not used[i]]
            if not ahead:
                break
            i = ahead[0]
            used[i] = True
            piece = pieces[i]
            if node[i, 0] == at:
                chain.append(piece)
                at = node[i, 1]
            else:
                chain.append(Piece(piece.segment.reversed(), piece.label))
                at = node[i, 0]
        if chain:
            chains.append(chain)
            closed += int(at == number)
    if closed == 0 and chains:
        raise OutlineError(f"{source}: the outline is open: {_gaps(chains, options.join_mm)}")
    if not chains:
        raise OutlineError(
            f"{source}: no outline found: all pieces are within {FILE_JOIN_TOLERANCE_MM:g} mm; check the units"
        )
    join_mm = max([FILE_JOIN_TOLERANCE_MM, *(1.000001 * gap for gap, _ in joined)])
    if len(chains) == 1:
        return closed_outline([piece.segment for piece in chains[0]], source, join_mm)
    extents = []
    for chain in chains[:4]:
        x_min, x_max, y_min, y_max = _extent(piece.segment for piece in chain)
        extents.append(f"x {x_min:.6g} to {x_max:.6g} and y {y_min:.6g} to {y_max:.6g} mm (from {chain[0].label})")
    found = (f"{closed} closed loop{'s' * (closed != 1)} and {len(chains) - closed} leftover open "
             f"piece{'s' * (len(chains) - closed != 1)}")
    if options.loop == "outermost":
        return _outermost(chains, file, join_mm, found, notes)
    raise OutlineError(
        f"{source}: {found} found, but an outline is one closed loop: {'; '.join(extents)}"
        f"{'; ...' if len(chains) > 4 else ''}; keep one and delete the rest, name its layer with outline.layer, or take the "
        "one around the others with outline.loop = \"outermost\""
    )


def _outermost(chains: list[list[Piece]], file: Path, join_mm: float, found: str, notes: list[str]) -> Outline:
    """The closed loop that everything else lies inside of."""
    whole = _extent(piece.segment for chain in chains for piece in chain)
    for chain in chains:
        is_open = math.dist(chain[0].segment.start, chain[-1].segment.end) > join_mm
        if is_open or not np.allclose(_extent(piece.segment for piece in chain), whole, rtol=0, atol=join_mm):
            continue
        outline = closed_outline([piece.segment for piece in chain], str(file), join_mm)
        others = [piece.segment for other in chains if other is not chain for piece in other]
        points = np.concatenate([segment.samples(0.1 * JOIN_MM) for segment in others])
        if outline.contains(points[:, 0], points[:, 1]).all():
            notes.append(f"{file.name}: {found} found; the loop around all others is the outline")
            return outline
    raise OutlineError(f"{file}: {found} found, and none of the loops is around all others; delete what is no outline")


def _gaps(chains: list[list[Piece]], join_mm: float) -> str:
    """What to say of open chains: each loose end with the loose end nearest to it."""
    ends = np.array([point for chain in chains for point in (chain[0].segment.start, chain[-1].segment.end)])
    labels = [label for chain in chains for label in (chain[0].label, chain[-1].label)]
    distance, nearest = cKDTree(ends).query(ends, k=2)
    found: dict[tuple[int, int], float] = {}
    for i in range(len(ends)):
        # Of two coincident points the query may name the point itself second.
        other = int(nearest[i, 1] if nearest[i, 1] != i else nearest[i, 0])
        found.setdefault((min(i, other), max(i, other)), float(distance[i, 1]))
    said = [
        f"gap of {size:.6g} mm between {point_text(ends[a])} ({labels[a]}) and {point_text(ends[b])} ({labels[b]})"
        for (a, b), size in list(found.items())[:4]
    ]
    return (
        f"{'; '.join(said)}{'; ...' if len(found) > 4 else ''}; gaps up to {join_mm:g} mm are closed: "
        "move the ends together or add the missing piece"
    )
