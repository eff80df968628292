"""Figures, tables and notebook representations of assemblies and results.

- `facts_of_assembly`: describe an assembly by named facts
- `facts_of_result`: describe a result by named facts
"""

from jld_core.views.notebook import facts_of_assembly, facts_of_result

__all__ = [
    "facts_of_assembly",
    "facts_of_result",
]
