"""Mitsuba's intersection of a mesh with smooth normals: numpy arrays in and out, one eye."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirror_studio.bench.tracers.case import Case, Mesh, Rays
from mirror_studio.bench.tracers.tracer import CORES, AbsentError, Tracer, Work, installed

NAME = "Mitsuba, {}"
LLVM, SCALAR = "llvm_ad_rgb", "scalar_rgb"
MAX_SCALAR = 1000  # rays, each a call from Python
NO_LLVM = "no libLLVM.so found: install LLVM, or name it in DRJIT_LIBLLVM_PATH"
# Older ones abort the process at the first picture: no code for llvm.maximum on x86. Rays alone do not need it.
MIN_LLVM_FOR_PICTURES = 17


def use(variant: str) -> Any:
    """Mitsuba, set to a variant. Raises: AbsentError where it is not installed or finds no LLVM library."""
    mi = installed("mitsuba")
    try:
        mi.set_variant(variant)
    except ImportError:
        raise AbsentError(NO_LLVM) from None
    installed("drjit").set_thread_count(CORES)
    return mi


def use_for_pictures(variant: str) -> Any:
    """The same. Raises: AbsentError too for an LLVM library that cannot compile a picture's kernel."""
    mi = use(variant)
    found = installed("drjit").detail.llvm_version() if variant == LLVM else (MIN_LLVM_FOR_PICTURES,)
    if found[0] < MIN_LLVM_FOR_PICTURES:
        raise AbsentError(f"the LLVM found is {found[0]}, pictures need {MIN_LLVM_FOR_PICTURES}: name a newer libLLVM.so in "
                          "DRJIT_LIBLLVM_PATH")
    return mi


def mesh_of(mi: Any, mesh: Mesh, name: str = "mirror", **more: Any) -> Any:
    """A mesh with smooth normals as Mitsuba holds it."""
    made = mi.Mesh(name, len(mesh.vertices), len(mesh.faces), has_vertex_normals=True, **more)
    parameters = mi.traverse(made)
    parameters["vertex_positions"] = np.ravel(mesh.vertices).astype(np.float32)
    parameters["vertex_normals"] = np.ravel(mesh.normals).astype(np.float32)
    parameters["faces"] = np.ravel(mesh.faces).astype(np.uint32)
    parameters.update()
    return made


def tracers(case: Case, triangles: int) -> Iterator[Tracer]:
    """The vectorised variant; the scalar one, ray by ray, where there is no LLVM library."""
    installed("mitsuba")
    mesh = case.mesh(triangles)
    try:
        mi = use(LLVM)
    except AbsentError:
        mi = use(SCALAR)
        scene = mi.load_dict({"type": "scene", "mirror": mesh_of(mi, mesh)})
        yield Tracer(NAME.format(SCALAR), lambda rays: _one_by_one(mi, scene, rays), MAX_SCALAR, NO_LLVM)
    else:
        scene = mi.load_dict({"type": "scene", "mirror": mesh_of(mi, mesh)})
        yield Tracer(NAME.format(LLVM), lambda rays: _arrays(mi, scene, rays))


def _arrays(mi: Any, scene: Any, rays: Rays) -> Work:
    dr = installed("drjit")
    directions = np.ascontiguousarray(rays.directions.T, dtype=np.float32)
    eye = mi.Point3f(*rays.origins.tolist())

    def work() -> NDArray[Any]:
        d = mi.Vector3f(directions)
        found = scene.ray_intersect(mi.Ray3f(eye, d))
        n = found.sh_frame.n
        out = dr.select(found.is_valid(), d - 2.0 * dr.dot(d, n) * n, dr.nan)
        return np.array(out).T

    return work


def _one_by_one(mi: Any, scene: Any, rays: Rays) -> Work:
    eye = mi.Point3f(*rays.origins.tolist())

    def work() -> NDArray[Any]:
        out = np.full(rays.directions.shape, np.nan)
        for i, d in enumerate(rays.directions):
            found = scene.ray_intersect(mi.Ray3f(eye, mi.Vector3f(*d.tolist())))
            if found.is_valid():
                n = np.array(found.sh_frame.n)
                out[i] = d - 2.0 * (d @ n) * n
        return out

    return work
