"""The compiled batch solver of `jld_core.batch`, optional: without a compiler the package is whole but for its
speed."""

from __future__ import annotations

import os
import runpy
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

HERE = Path(__file__).parent
BATCH = Path("src") / "jld_core" / "batch"
KNOWN = runpy.run_path(str(HERE / BATCH / "build.py"), run_name="build")


class Build(build_ext):
    """Plain shared libraries: no Python headers, no module to initialise; variants are compiled at the same time."""

    def finalize_options(self) -> None:
        super().finalize_options()
        self.parallel = self.parallel or os.cpu_count()

    def build_extensions(self) -> None:
        """Write the header of the interface, and compile."""
        place = Path(self.build_temp)
        place.mkdir(parents=True, exist_ok=True)
        KNOWN["write_header"](place)
        for ext in self.extensions:
            ext.include_dirs.append(str(place))
        super().build_extensions()

    def get_export_symbols(self, ext: Extension) -> list[str]:
        return list(ext.export_symbols)


def extension(variant: str) -> Extension:
    source = BATCH / "source"
    return Extension(
        f"jld_core.batch._{variant}",
        sources=[str(source / name) for name in KNOWN["UNITS"]],
        depends=[
            str(BATCH / "interface.py"),
            *(str(path.relative_to(HERE)) for path in sorted((HERE / source).glob("*.h"))),
        ],
        extra_compile_args=[*KNOWN["FLAGS"], *KNOWN["VARIANT_FLAGS"][variant], KNOWN["mark"](), "-Wno-psabi"],
        language="c++",
        optional=True,
    )


# `make setup` compiles beside the installation instead, by `build.py --in-place`
APART = os.environ.get("JLD_COMPILED_APART") == "1"
setup(
    ext_modules=[] if APART else [extension(variant) for variant in KNOWN["variants"]()], cmdclass={"build_ext": Build}
)
