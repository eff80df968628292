"""Files of other programs, which `jld_formats` reads and writes: `import_file`, `export` and others, by these names."""

from __future__ import annotations

from jld_core.layout import Layout as Layout
from jld_core.layout import blocks_csv as blocks_csv
from jld_core.plugins import door

__getattr__ = door("exchange")
