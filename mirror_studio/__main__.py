"""`python -m mirror_studio` is `mirror-cad`."""

from mirror_studio.cli import main

main()
