"""Stage 2a: which points of two boundaries correspond."""
