"""The driver, its options and its result."""
