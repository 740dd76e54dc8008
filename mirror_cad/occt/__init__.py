"""The kernel: the only modules that import OCP, build123d and cadquery. They take and return our records."""

from mirror_cad.occt.kernel import check_kernel

check_kernel()
