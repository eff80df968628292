"""Compile the batch solver: one shared library per variant, by the system's compiler or that of `ziglang`.

`setup.py` and ``--in-place`` compile into the package, with ``--best`` or ``--ends`` the best variant or also the base;
else the first use compiles the best into the user's cache. `setup.py` loads it alone: it imports nothing of the
package.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import os
import platform
import runpy
import shlex
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path
from threading import BoundedSemaphore
from typing import Final

SOURCE: Final = Path(__file__).parent / "source"  # folder of the C++ source
UNITS: Final = (  # translation units, slowest first, compiled at the same time
    "planar_labellings.cpp",
    "spatial_labellings.cpp",
    "planar_narrow.cpp",
    "block_program.cpp",
    "labellings.cpp",
    "cones.cpp",
    "graphs.cpp",
    "fronts.cpp",
)
UNIT_FLAGS: Final[dict[str, tuple[str, ...]]] = {"cones.cpp": ("-ffp-contract=off",)}
"""Compiler flags of single units. Cone programs write fused products out, and round alike alone and together."""
INTERFACE: Final = Path(__file__).parent / "interface.py"
"""Module that states the C interface; the header and the hash of the sources depend on it."""
# Seconds after which a compiler is given up on first use; 24 s of one core were measured for the largest variant.
PATIENCE: Final = 600.0
# Compiler flags of every variant, without fast-math: proofs compare with infinities and rely on the order of sums.
FLAGS: Final = ("-std=c++17", "-O3", "-fno-math-errno", "-fno-trapping-math", "-g0")

VARIANT_FLAGS: Final[dict[str, tuple[str, ...]]] = {  # compiler flags of each variant
    # Default tuning avoids chains of fused products; it was measured 25 % slower here.
    "avx512": (
        *("-mavx512f", "-mavx512dq", "-mavx512vl", "-mavx2", "-mfma"),
        *("-mprefer-vector-width=512", "-mtune=icelake-server"),
    ),
    "avx2": ("-mavx2", "-mfma", "-mtune=haswell"),
    "base": (),
    "neon": (),
}
NEEDED: Final[dict[str, tuple[str, ...]]] = {  # processor flags that each variant needs, as /proc/cpuinfo names them
    "avx512": ("avx512f", "avx512dq", "avx512vl"),
    "avx2": ("avx2", "fma"),
    "neon": (),
    "base": (),
}

# Compiler flags of code for shared libraries; code for Windows can always be moved
_SHARED: Final = () if os.name == "nt" else ("-fPIC",)
SANITIZED: Final[dict[str, tuple[str, ...]]] = {
    "--sanitized": ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=undefined"),
    "--thread-sanitized": ("-g", "-O1", "-fsanitize=thread"),
}
"""Command-line options of `main` for libraries with sanitizers, and the compiler flags of each."""


def variants() -> tuple[str, ...]:
    """Return the variants for this family of processors, fastest first; this one may lack their instructions."""
    # Nothing of the package is imported here: `setup.py` loads this module before the package exists.
    machine = platform.machine().lower()
    if machine in ("x86_64", "amd64"):
        return ("avx512", "avx2", "base")
    return ("neon",) if machine in ("aarch64", "arm64") else ("base",)


def runs_here(variant: str) -> bool:
    return set(NEEDED[variant]) <= processor_flags()


@lru_cache(maxsize=1)
def processor_flags() -> frozenset[str]:
    """Return the flags of this processor; an empty set where they are unknown."""
    # Flags are read from /proc/cpuinfo; on systems without that file numpy is asked, where it is installed.
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return _numpy_flags()
    for line in text.splitlines():
        if line.startswith("flags"):
            return frozenset(line.partition(":")[2].split())
    return frozenset()


def _numpy_flags() -> frozenset[str]:
    """Return the flags of this processor that numpy has found, named as in /proc/cpuinfo."""
    try:
        features = importlib.import_module("numpy._core._multiarray_umath").__cpu_features__
    except (ImportError, AttributeError):  # compiled before numpy is installed, or by a numpy that has moved this table
        return frozenset()
    return frozenset({"FMA3": "fma"}.get(name, name.lower()) for name, present in features.items() if present)


def best() -> str:
    """Return the fastest variant whose instructions this processor has."""
    return next(name for name in variants() if runs_here(name))


def digest() -> str:
    """Return a hash (16 characters) of sources, interface and flags, which validates a cached library."""
    content = hashlib.sha256(repr((FLAGS, VARIANT_FLAGS, UNIT_FLAGS)).encode())
    for path in [INTERFACE, *sorted(SOURCE.iterdir())]:
        content.update(path.name.encode() + path.read_bytes())
    return content.hexdigest()[:16]


def mark() -> str:
    """Return the compiler flag that writes the hash of the sources into a library."""
    return f'-DJLD_SOURCES="{digest()}"'


def is_current(library: Path) -> bool:
    """Return True if a library was compiled from the present sources, or there are no sources."""
    # Read the file without loading it: a library for another processor may crash on loading.
    return not SOURCE.is_dir() or digest().encode() in library.read_bytes()


def cache() -> Path:
    """Return the folder of libraries that are compiled on first use."""
    root = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(root) / "jld" / "kernels" / digest()


def zig() -> list[str] | None:
    """Return the compiler command of the package `ziglang`; None if it is not installed."""
    return [sys.executable, "-m", "ziglang", "c++"] if importlib.util.find_spec("ziglang") else None


def compilers() -> list[list[str]]:
    """Return the compiler commands to try: $CXX, the system's, ziglang's."""
    named = os.environ.get("CXX")
    commands = [shlex.split(named)] if named else []
    commands += [[path] for path in map(shutil.which, ("c++", "g++", "clang++")) if path]
    bundled = zig()
    return [*commands, bundled] if bundled else commands


def write_header(folder: Path) -> None:
    """Write the C header `interface.h`, which the sources include, into an existing folder."""
    text = runpy.run_path(str(INTERFACE), run_name="interface")["header"]()
    (folder / "interface.h").write_text(text, encoding="utf-8")


# Compilers that run at the same time, over all variants: one per core, since each takes up to 0.4 GB
_RUNNING: Final = BoundedSemaphore(os.cpu_count() or 1)


def compile_variant(
    variant: str, folder: Path, compiler: list[str], extra: tuple[str, ...] = (), patience: float | None = None
) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / f"_{variant}.so"
    flags = [*compiler, *FLAGS, *VARIANT_FLAGS[variant], mark(), *_SHARED, *extra]

    def run(*arguments: str) -> None:
        with _RUNNING:
            subprocess.run([*flags, *arguments], check=True, capture_output=True, text=True, timeout=patience)

    # Write to another name first, because another process may be loading the library.
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        write_header(Path(scratch))
        library = Path(scratch) / target.name
        objects = [str(Path(scratch) / f"{unit}.o") for unit in UNITS]
        with ThreadPoolExecutor(len(UNITS)) as pool:
            pending = [
                pool.submit(run, *UNIT_FLAGS.get(unit, ()), f"-I{scratch}", "-c", str(SOURCE / unit), "-o", compiled)
                for unit, compiled in zip(UNITS, objects, strict=True)
            ]
        for task in pending:
            task.result()
        run("-shared", *objects, "-o", str(library))
        library.replace(target)
    return target


def reason_of(problem: OSError | subprocess.SubprocessError) -> str:
    """Return in a few words why a compiler failed: its first error, or how it ended."""
    if isinstance(problem, subprocess.TimeoutExpired):
        return f"no result after {problem.timeout:.0f} s"
    if isinstance(problem, subprocess.CalledProcessError):
        errors = [line.strip() for line in str(problem.stderr or "").splitlines() if "error" in line.lower()]
        return errors[0] if errors else f"exit status {problem.returncode}"
    return str(problem)


def compile_by_any(variant: str, folder: Path, extra: tuple[str, ...] = ()) -> tuple[Path | None, list[str]]:
    """Compile one variant with the first compiler that works; path or None, and a line per failed one."""
    problems = list[str]()
    for compiler in compilers():
        try:
            return compile_variant(variant, folder, compiler, extra), problems
        except (OSError, subprocess.SubprocessError) as problem:
            problems.append(f"{variant} by {' '.join(compiler)}: {reason_of(problem)}")
    return None, problems


def remove_others(library: Path) -> None:
    """Remove the other libraries of the same variant, which would be found first."""
    for other in library.parent.glob(f"{library.stem}.*"):
        if other != library:
            other.unlink()


def main() -> None:
    """Compile variants of the batch solver for this machine, and print their paths."""
    # Command-line arguments: names of variants (default: all); or --in-place (all that are not there, into the
    # package); or --in-place --best (the best one of this processor only); or --in-place --ends (that one and the base
    # of the family); or --sanitized FOLDER (addresses and undefined behaviour); or --thread-sanitized FOLDER (data
    # races). The last two use the compiler's sanitizers.
    extra: tuple[str, ...] = ()
    folder, names = cache(), sys.argv[1:] or list(variants())
    in_place = names[0] == "--in-place"
    if in_place:
        options = {"--best": [best()], "--ends": list(dict.fromkeys((best(), variants()[-1])))}
        folder, names = Path(__file__).parent, options.get("".join(names[1:]), list(variants()))
        built = {name: folder / f"_{name}.so" for name in names}
        names = [name for name, path in built.items() if not (path.exists() and is_current(path))]
    elif names[0] in SANITIZED:
        folder, extra, names = Path(names[1]), SANITIZED[names[0]], [variants()[-1]]
    # Each compiler is a process of its own, so threads keep all cores busy.
    with ThreadPoolExecutor(max(len(names), 1)) as pool:
        compiled = list(pool.map(lambda variant: compile_by_any(variant, folder, extra), names))
    for variant, (library, problems) in zip(names, compiled, strict=True):
        sys.stderr.writelines(f"{line}\n" for line in problems)
        if library is not None:
            if in_place:
                remove_others(library)
            sys.stdout.write(f"{variant}: {library}\n")
    missing = ", ".join(variant for variant, (library, _) in zip(names, compiled, strict=True) if library is None)
    if missing:
        sys.exit(f"{missing}: no compiler that works; pip install jld[compiler] brings one")


if __name__ == "__main__":
    main()
