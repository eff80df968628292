"""Sparse factors and projections. Knows no Assembly."""
