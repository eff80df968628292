"""Files of other programs, which `jld_formats` reads and writes: `import_file`, `export` and others, by these names."""

from __future__ import annotations

from typing import Any

from jld_core.layout import Layout as Layout
from jld_core.layout import blocks_csv as blocks_csv
from jld_core.plugins import part


def __getattr__(name: str) -> Any:
    if name.startswith("__"):
        raise AttributeError(name)
    return getattr(part("exchange"), name)
