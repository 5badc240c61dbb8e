"""Stages 4 to 9: from boundary points to all control points of a certified map."""
