"""What can go wrong, as exceptions whose messages name what, where, the numbers and what to do."""


class MirrorError(Exception):
    """Base of every error that a user can mend: the command line shows its message alone and exits with 2."""


class SpecError(MirrorError):
    """A specification that cannot be read or built: `faults` lists every fault found, one sentence each."""

    def __init__(self, faults: list[str] | str) -> None:
        self.faults = [faults] if isinstance(faults, str) else list(faults)
        super().__init__("\n".join(self.faults))


class ProfileError(MirrorError):
    """A curvature law that no profile or section can have: it turns vertical, or its circle is too small."""


class SurfaceError(MirrorError):
    """A point set or surface that cannot be fitted or evaluated."""


class OutlineError(MirrorError):
    """An outline that is not one closed simple loop inside its blank, or a file that does not hold one."""


class SolidError(MirrorError):
    """A plate that cannot be made from its surface, outline and thickness."""


class FileError(MirrorError):
    """A file given by the user that cannot be read, or holds nothing that can be used."""


class WriteError(MirrorError):
    """A file of our own that cannot be written (a full disk), or reads back different from what was meant."""


class InstallationError(MirrorError, ImportError):
    """A library that is not installed here, or not as this package needs it: the CAD kernel, Embree."""
