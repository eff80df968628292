"""Provide the entry point of the `jld` command and of `python -m jld_explore`."""

from __future__ import annotations

import gc
import os
import sys
import time


def _leave_out_local_style() -> None:
    """Load matplotlib now where the current folder has a matplotlibrc, without reading it: it may be of any kind."""
    if not os.path.exists("matplotlibrc"):
        return
    folder = os.getcwd()
    try:
        os.chdir(os.path.dirname(os.path.abspath(__file__)))
        import matplotlib  # noqa: F401 – reads its settings here and never again
    finally:
        os.chdir(folder)


def _import_scipy() -> None:
    """Import scipy without those parts of numpy that nothing here uses: 0.1 s, a third of loading for `jld solve`."""
    # scipy.sparse copies the namespace of numpy, which loads every part that numpy itself loads when it is named (f2py,
    # testing, ma, polynomial, ...). They are out of sight meanwhile, and load as ever when they are named afterwards.
    import numpy

    parts: set[str] = getattr(numpy, "__numpy_submodules__", set())
    if not (isinstance(numpy.__all__, list) and isinstance(parts, set)):  # a numpy of another make
        return
    names = list(numpy.__all__)
    hidden = {name for name in {*names, *parts} if name not in vars(numpy)}
    hidden_parts = parts & hidden
    try:
        numpy.__all__[:] = [name for name in names if name not in hidden]
        parts -= hidden
        import scipy.sparse.linalg  # noqa: F401
    finally:
        numpy.__all__[:] = names
        parts |= hidden_parts


def main() -> None:
    """Run the command line `jld` with one BLAS thread per process."""
    # The matrices of one labelling are small, and the cores are used for different labellings. With one BLAS thread per
    # core the same search took up to 17 times as long on a busy machine. The environment must be set before numpy is
    # imported.
    started = time.perf_counter()
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    # jld uses no plug-in of pydantic; looking for one reads the metadata of every package installed.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    try:
        from jld_core.errors import InputError
        from jld_explore.cli.streams import failed, open_streams, say, warn

        open_streams()
        if sys.argv[1:] == ["--help"]:
            from jld_explore.cli.overview import text  # The modules imported below take a second to load.

            try:
                say(text().removesuffix("\n"))
                sys.exit(0)
            except (InputError, OSError) as error:  # entry points of a plug-in may be wrong
                warn(failed(error) if isinstance(error, OSError) else f"jld: {error}")
                sys.exit(2)
        _leave_out_local_style()
        gc.disable()  # Nothing loaded becomes garbage; collections took 7 % of loading. `command` enables it again.
        _import_scipy()
        from jld_explore.cli.command import main as command
        from jld_explore.cli.ending import ignore_signals
    except KeyboardInterrupt:  # Nothing has begun while modules are loading.
        from jld_explore.cli.streams import STOPPED, STOPPED_WORDS, warn

        warn(STOPPED_WORDS)
        sys.exit(STOPPED)
    try:
        command(started)
    finally:
        ignore_signals()


if __name__ == "__main__":
    main()
