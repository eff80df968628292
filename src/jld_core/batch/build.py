"""Compiling the batch solver: one shared library per variant, by the compiler that is there or the one of `ziglang`.

`setup.py` builds all variants of a processor family into the package; where that was not possible the first use
compiles what this processor runs, once, into the user's cache. `python -m jld_core.batch.build` says what it does.
This module imports nothing of the package, since `setup.py` reads it before there is one.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

SOURCE: Final = Path(__file__).parent / "source"
FLAGS: Final = ("-std=c++17", "-O3", "-fno-math-errno", "-fno-trapping-math", "-g0")
"""For every variant. No fast-math: proofs compare with infinities and count on the order of sums."""

VARIANT_FLAGS: Final[dict[str, tuple[str, ...]]] = {
    # the usual tuning is for processors that mind chains of products; it takes a quarter longer
    "avx512": (
        *("-mavx512f", "-mavx512dq", "-mavx512vl", "-mavx2", "-mfma"),
        *("-mprefer-vector-width=512", "-mtune=icelake-server"),
    ),
    "avx2": ("-mavx2", "-mfma", "-mtune=haswell"),
    "base": (),
    "neon": (),
}
_LINKED: Final = ("-fPIC", "-shared")
SANITIZED: Final[dict[str, tuple[str, ...]]] = {
    "--sanitized": ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=undefined"),
    "--thread-sanitized": ("-g", "-O1", "-fsanitize=thread"),
}
"""Options of the command line for libraries that check themselves, and what the compiler is told for them."""


def variants(machine: str | None = None) -> tuple[str, ...]:
    """Variants of a processor family, fastest first; default this machine's."""
    machine = (machine or platform.machine()).lower()
    if machine in ("x86_64", "amd64"):
        return ("avx512", "avx2", "base")
    return ("neon",) if machine in ("aarch64", "arm64") else ("base",)


def digest() -> str:
    """Of all sources and flags: a library in the cache is of use as long as it is the same."""
    content = hashlib.sha256(repr((FLAGS, VARIANT_FLAGS)).encode())
    for path in sorted(SOURCE.iterdir()):
        content.update(path.name.encode() + path.read_bytes())
    return content.hexdigest()[:16]


def mark() -> str:
    """A flag by which a library says what it was made of."""
    return f'-DJLD_SOURCES="{digest()}"'


def is_current(library: Path) -> bool:
    """Is a library made of the sources that are here, or are there none to ask?"""
    # read and not loaded: what this processor does not run may crash while it is loaded
    return not SOURCE.is_dir() or digest().encode() in library.read_bytes()


def cache() -> Path:
    """Folder of libraries that were compiled on first use."""
    root = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(root) / "jld" / "kernels" / digest()


def zig() -> list[str] | None:
    """The compiler of the package `ziglang`, where it is installed."""
    return [sys.executable, "-m", "ziglang", "c++"] if importlib.util.find_spec("ziglang") else None


def compilers() -> list[list[str]]:
    """Commands to try, in order: $CXX, the system's, ziglang's."""
    named = os.environ.get("CXX")
    found = [named.split()] if named else []
    found += [[path] for path in map(shutil.which, ("c++", "g++", "clang++")) if path]
    own = zig()
    return [*found, own] if own else found


def compile_variant(variant: str, folder: Path, compiler: list[str], extra: tuple[str, ...] = ()) -> Path:
    """Compile one variant to `folder`/_VARIANT.so. Raises subprocess.CalledProcessError or OSError if that fails."""
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / f"_{variant}.so"
    # written under another name first: another process may be loading it
    with tempfile.TemporaryDirectory(dir=folder) as place:
        made = Path(place) / target.name
        command = [*compiler, *FLAGS, *VARIANT_FLAGS[variant], mark(), *_LINKED, *extra, str(SOURCE / "kernel.cpp")]
        subprocess.run([*command, "-o", str(made)], check=True, capture_output=True, text=True)
        made.replace(target)
    return target


def main() -> None:
    """Compile variants of this machine into the cache, or a checked one into a folder, and say so.

    Arguments: names of variants (default: all); or --sanitized FOLDER (addresses and undefined behaviour) or
    --thread-sanitized FOLDER (data races), with the sanitizers of the compiler.
    """
    extra: tuple[str, ...] = ()
    folder, wanted = cache(), sys.argv[1:] or list(variants())
    if wanted[0] in SANITIZED:
        folder, extra, wanted = Path(wanted[1]), SANITIZED[wanted[0]], [variants()[-1]]
    for variant in wanted:
        for compiler in compilers():
            try:
                made = compile_variant(variant, folder, compiler, extra)
            except (OSError, subprocess.CalledProcessError) as problem:
                sys.stderr.write(f"{variant} by {' '.join(compiler)}: {problem}\n")
                continue
            sys.stdout.write(f"{variant}: {made}\n")
            break
        else:
            sys.exit(f"{variant}: no compiler that works; pip install jld[compiler] brings one")


if __name__ == "__main__":
    main()
