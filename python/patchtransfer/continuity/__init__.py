"""Rows across interfaces and around vertices, C1 and G1, and their null space."""
