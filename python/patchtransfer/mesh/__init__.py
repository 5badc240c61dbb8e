"""Triangle meshes of control nets, and discrete harmonic maps on them."""
