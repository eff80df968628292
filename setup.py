"""The compiled batch solver of `jld_core.batch`, optional: without a compiler the package is whole but for its
speed."""

from __future__ import annotations

import os
import runpy
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

HERE = Path(__file__).parent
BATCH = Path("src") / "jld_core" / "batch"
KNOWN = runpy.run_path(str(HERE / BATCH / "build.py"), run_name="build")


class Build(build_ext):
    """Plain shared libraries by the compilers that `build.py` finds; setuptools' own does not take them on Windows."""

    def library(self, ext: Extension) -> Path:
        """Path of a library where it is compiled into, the source tree or that of the build."""
        root = HERE / "src" if self.inplace else Path(self.build_lib)
        return root / "jld_core" / "batch" / f"{ext.name.rpartition('.')[2]}.so"

    def run(self) -> None:
        """Compile all variants at the same time; one that no compiler takes is left out, with a line that says so."""
        targets = [self.library(ext) for ext in self.extensions]
        with ThreadPoolExecutor(max(len(targets), 1)) as pool:
            made = list(pool.map(lambda one: KNOWN["compile_by_any"](one.stem[1:], one.parent), targets))
        for target, (found, problems) in zip(targets, made, strict=True):
            if found is None:
                why = "; ".join(problems) or "no C++ compiler was found"
                sys.stderr.write(f"jld: this package goes without the batch solver {target.stem[1:]}: {why}\n")

    def get_outputs(self) -> list[str]:
        """Paths of the libraries that were compiled."""
        return [str(path) for path in map(self.library, self.extensions) if path.exists()]

    def get_output_mapping(self) -> dict[str, str]:
        """No file of the source tree stands for a library of the build."""
        return {}


# `make` compiles beside the installation instead, by `build.py --in-place`
APART = os.environ.get("JLD_COMPILED_APART") == "1"
setup(
    ext_modules=[] if APART else [Extension(f"jld_core.batch._{name}", sources=[]) for name in KNOWN["variants"]()],
    cmdclass={"build_ext": Build},
)
