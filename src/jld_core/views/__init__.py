"""Facts of assemblies and results in words; figures and notebook output, which `jld_views` draws, by the same names."""

from __future__ import annotations

from jld_core.plugins import door
from jld_core.views import facts
from jld_core.views.facts import facts_of_assembly, facts_of_result

__all__ = ["facts", "facts_of_assembly", "facts_of_result"]

__getattr__ = door("views")
