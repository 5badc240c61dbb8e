"""Stage 2b: target curves on the source's boundary sides, and more knots where these are too few."""
