"""The kernel: the only modules that import OCP, build123d and cadquery. Our records in, shapes and files out."""

from mirror_cad.occt.kernel import check_kernel

check_kernel()
