"""Conic program of one labelling, and the template that a relabelling changes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.lazy_exports import export_lazily
from jld_core.program.template import ConicProgram, Template, beginnings, pack

if TYPE_CHECKING:
    from jld_core.program.template import Beside

__all__ = ["Beside", "ConicProgram", "Template", "beginnings", "pack"]

export_lazily(__name__, {"template": ["Beside"]})
