"""Reports on a multi-patch: quality and continuity."""
