"""Equilibrium, scaling, and what a yield set is."""
