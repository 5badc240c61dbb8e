"""Between two models, and under dragged boundary points."""
