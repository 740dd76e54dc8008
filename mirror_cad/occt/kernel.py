"""Say what is wrong where the kernel is not the one that this package needs, and what mends it.

build123d depends on the distribution cadquery-ocp-novtk and cadquery on cadquery-ocp. Both put their files into one folder,
OCP; the second has all that the first has, and the door to VTK besides, without which cadquery cannot be imported. Where
the first was written over the second, or one was taken away and half of the other with it, imports fail far from the cause.
"""

from __future__ import annotations

from mirror_cad.errors import InstallationError

SERIES = "7.9."  # of OCP: another one changes names and signatures
FULL, PART = "cadquery-ocp", "cadquery-ocp-novtk"


def check_kernel() -> None:
    """Import OCP, and make sure that it is whole and of SERIES.

    Raises
    ------
    InstallationError
        With the cause and the commands that mend it.
    """
    try:
        import OCP
    except ModuleNotFoundError as error:
        raise InstallationError(f"the CAD kernel OCP is not here, or not whole ({error}): {_remedy()}") from error
    except ImportError as error:  # its files are here, and what they load from the system is not
        raise InstallationError(f"the CAD kernel OCP cannot be loaded: {error}. It needs libGL, libX11 and libexpat of the "
                                f"system; on Debian or Ubuntu:  apt-get install libgl1 libx11-6 libexpat1") from error
    found = getattr(OCP, "__version__", None)
    if found is None:  # to Python a folder without its __init__.py is a package too
        raise InstallationError(f"the CAD kernel OCP is not whole, only remains of it are in {next(iter(OCP.__path__))}: "
                                f"{_remedy()}")
    if not found.startswith(SERIES):
        raise InstallationError(f"the CAD kernel OCP is {found} here, and {SERIES}x is needed: {_remedy()}")


def check_kernel_for_cadquery() -> None:
    """Make sure that OCP has the door to VTK.

    Raises
    ------
    InstallationError
        With the cause and the commands that mend it.
    """
    import OCP

    if not hasattr(OCP, "IVtkOCC"):
        raise InstallationError(f"cadquery cannot be imported: {PART} lies over {FULL} here and has no door to VTK: "
                                f"{_remedy()}")


def _remedy() -> str:
    """The commands that leave one whole kernel: of the version that is installed, where it is one that fits."""
    from importlib.metadata import PackageNotFoundError, version  # loaded only for this

    wanted = f"{SERIES}*"
    for name in (FULL, PART):
        try:
            found = version(name)
        except PackageNotFoundError:
            continue
        if found.startswith(SERIES):
            wanted = found
            break
    return (f"python -m pip uninstall -y {PART}  and then  "
            f"python -m pip install --force-reinstall --no-deps {FULL}=={wanted}  mend it")
