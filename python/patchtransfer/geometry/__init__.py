"""Stage 1: splines, patches, interfaces, what they bound, and the combinatorics of a multi-patch."""
