"""Sources of transfers: layouts of quads."""
