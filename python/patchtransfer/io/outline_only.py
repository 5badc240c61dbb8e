"""The error of a file without patches, which a conversion answers by reading its outline."""

from __future__ import annotations

from ..errors import InputError

__all__ = ["OutlineOnlyError"]


class OutlineOnlyError(InputError):
    """The file holds the outline of a domain, and no patches."""

    def __init__(self, what: str) -> None:
        super().__init__(f"{what}; use read_boundary, and parameterize for patches")
