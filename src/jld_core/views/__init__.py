"""Assemblies and results, drawn and shown.

- `facts_of_assembly`: what is modelled, by name
- `facts_of_result`: what came out, by name
"""

from jld_core.views.notebook import facts_of_assembly, facts_of_result

__all__ = [
    "facts_of_assembly",
    "facts_of_result",
]
