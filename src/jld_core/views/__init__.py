"""Assemblies and results, drawn and shown."""

from jld_core.views.notebook import facts_of_assembly, facts_of_result

__all__ = [
    "facts_of_assembly",
    "facts_of_result",
]
