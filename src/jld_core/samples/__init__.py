"""Parametric structures of use to anyone."""
