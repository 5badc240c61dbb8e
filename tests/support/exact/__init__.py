"""A second opinion on injectivity in exact arithmetic, models on which it matters, and the certificate under limits."""
