"""Proofs: whether a boundary admits a map, whether a multi-patch is injective."""
