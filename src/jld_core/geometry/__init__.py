"""Polygons, polyhedra, and where they touch. Knows no Assembly."""
