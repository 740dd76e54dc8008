"""What can go wrong in a trace, as exceptions whose messages name what, where and what to do."""

from mirror_cad.errors import MirrorError


class TraceError(MirrorError):
    """Rays, an eye or a reflector that no trace can be made with."""


class SceneError(MirrorError):
    """A picture or scene that cannot be used."""
