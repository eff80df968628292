"""Optional libraries of some formats, and checks of input files."""

from __future__ import annotations

import gc
import multiprocessing
import os
import pickle
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any, Final, cast

from jld_core.errors import InputError
from jld_core.exchange.drawing import planar_scene
from jld_core.exchange.drawn_loads import Drawing
from jld_core.exchange.formats import readers
from jld_core.exchange.options import Imported, ImportOptions, Notes
from jld_core.exchange.solids import Solids, spatial_scene

EXTRAS: Final = {"ezdxf": "dxf", "ifcopenshell": "ifc", "meshio": "mesh", "rhino3dm": "rhino", "svgelements": "svg"}
"""Extra of this project that installs each library."""

# What to save instead, by the ending of files that are not read
_INSTEAD: Final = {
    **dict.fromkeys(("dwg", "dgn"), "a DXF of it, any version"),
    **dict.fromkeys(
        ("skp", "dae", "blend", "fbx", "gltf", "glb", "3ds", "3mf"), "an OBJ, STL or PLY of it, one object a block"
    ),
    **dict.fromkeys(("fcstd", "sldprt", "sldasm", "ipt", "iges", "igs", "sat"), "a STEP of it (.step)"),
    **dict.fromkeys(("rvt", "pln", "ifczip", "ifcxml"), "an IFC of it (.ifc)"),
    **dict.fromkeys(("ai", "pdf", "eps", "svgz", "cdr"), "an SVG of it, not compressed"),
    **dict.fromkeys(("xlsx", "ods"), "a CSV of it: id, x, y"),
    "gh": "the baked geometry as .3dm",
}

_LARGEST: Final = 64 * 1024 * 1024  # largest size of a file, bytes; parsers need about thirty times as much memory


def library(name: str, path: Path) -> Any:
    """Import an optional library and return its module.

    Raises InputError that names the extra to install where the library is missing.
    """
    try:
        return import_module(name)
    except ImportError:
        raise InputError(
            str(path), f"files of this kind need {name}, which is not installed", f"pip install 'jld[{EXTRAS[name]}]'"
        ) from None


def readable(path: Path) -> Path:
    """Return the path of a file that exists, is not empty and has at most 64 MB.

    Raises InputError for any other file.
    """
    try:
        size = path.stat().st_size
        with path.open("rb") as stream:
            stream.read(1)
    except OSError as error:
        raise InputError(str(path), error.strerror or "it cannot be read", "a readable file") from None
    if size > _LARGEST:
        raise InputError(str(path), f"it is {size / 2**20:.0f} MB large", f"at most {_LARGEST >> 20} MB")
    if size == 0:
        raise InputError(str(path), "it is empty", "a file with a structure in it")
    return path


def text_of(path: Path) -> str:
    """Return the content of a UTF-8 text file, without a byte order mark.

    Raises InputError for a file in another encoding, or one that `readable` refuses.
    """
    try:
        return readable(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(str(path), "it is not UTF-8 text", "a text in UTF-8") from None


@contextmanager
def without_collection() -> Iterator[None]:
    """Keep the garbage collector from searching again and again through thousands of objects that stay."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


@contextmanager
def parsing(kind: str, expected: str) -> Iterator[None]:
    """Make the calls inside this context raise InputError for a file that cannot be parsed.

    Any exception is converted; an InputError stays as it is.
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        raise InputError(
            "", f"it is no {kind} that can be read: it is damaged, or of another kind", expected
        ) from error


# Program of a process that calls one function, where processes cannot be forked
_CHILD: Final = """
import pickle, sys
from jld_core.exchange.libraries import store_result
with open(sys.argv[1], "rb") as stream:
    function, arguments = pickle.load(stream)
store_result(sys.argv[2], function, arguments)
"""


def store_result(path: str, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    """Write the result of a call, or what it raised, to a file."""
    try:
        found = function(*arguments)
    except BaseException as error:
        found = error
    Path(path).write_bytes(pickle.dumps(found))


def in_own_process(function: Callable[..., Any], *arguments: Any, seconds: float) -> Any:
    """Call a function of a module in a process of its own and return its result."""
    # A library of compiled code that a damaged file sends into a loop, or to its end, cannot be stopped otherwise.
    again = "a file that its program opens and saves again"
    with tempfile.TemporaryDirectory(prefix="jld-") as folder:
        made = Path(folder) / "made"
        if not (_forked if sys.platform == "linux" else _begun)(made, function, arguments, seconds):
            raise InputError("", f"reading it does not end in {seconds:.0f} s: it is damaged, or too large", again)
        if not made.exists() or not made.stat().st_size:
            raise InputError("", "its reader broke down: it is damaged", again)
        found = pickle.loads(made.read_bytes())
    if isinstance(found, BaseException):
        raise found
    return found


def _forked(made: Path, function: Callable[..., Any], arguments: tuple[Any, ...], seconds: float) -> bool:
    """Call a function in a copy of this process, which has all modules loaded; return False if it did not end."""
    child = multiprocessing.get_context("fork").Process(target=store_result, args=(str(made), function, arguments))
    with warnings.catch_warnings():
        # other threads do not run in the copy; one that waits for a lock of theirs is ended with it
        warnings.simplefilter("ignore", DeprecationWarning)
        child.start()
    try:
        child.join(seconds)
        return not child.is_alive()
    finally:
        child.kill()
        child.join()


def _begun(made: Path, function: Callable[..., Any], arguments: tuple[Any, ...], seconds: float) -> bool:
    """Call a function in a new process; return False if it did not end."""
    given = made.with_name("given")
    given.write_bytes(pickle.dumps((function, arguments)))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(part for part in sys.path if part)}
    try:
        command = [sys.executable, "-c", _CHILD, str(given), str(made)]
        subprocess.run(command, env=environment, timeout=seconds, capture_output=True, check=False)
    except subprocess.TimeoutExpired:
        return False
    return True


def import_file(path: str | Path, options: ImportOptions | None = None) -> Imported:
    """Convert a file of another program to a scene document, by the ending of its name.

    Parameters
    ----------
    path : str or Path
        File to read; its ending is one of `formats.readers`.
    options : ImportOptions, optional
        How the file is read.

    Returns
    -------
    Imported
        Scene document for `parse_scene`, and a report of what was found, snapped, assumed and skipped.

    Raises
    ------
    InputError
        The file is broken, excessive, of an unknown kind, or holds no possible scene.
    """
    path, options, notes = Path(path), options or ImportOptions(), Notes()
    with reading(path), without_collection():
        found = read_content(path, options, notes)
        if isinstance(found, Solids):
            return spatial_scene(found, options, notes)
        return planar_scene(found, options, notes)


_SECONDS: Final = 60.0  # time in which a file of such a reader must be read, s, beside that for its size

_SECONDS_PER_MEGABYTE: Final = 5.0  # further time for each megabyte of such a file, s


def _read_compiled(path: Path, options: ImportOptions) -> tuple[Drawing | Solids, Notes]:
    """Read a file by a reader that calls compiled code, for `in_own_process`."""
    notes = Notes()
    read = readers()[path.suffix.lower().lstrip(".")].read
    assert read is not None
    return read(path, options, notes), notes


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Make errors about the content of a file name that file.

    Errors about the file itself and about options stay.
    """
    try:
        yield
    except InputError as error:
        stays = error.parameter or error.where.startswith(str(path))
        raise (error if stays else error.within(str(path))) from error.__cause__


def read_content(path: Path, options: ImportOptions, notes: Notes) -> Drawing | Solids:
    """Read a file by the ending of its name: the paths of a drawing, or solids.

    Raises InputError for an unknown kind and what its reader refuses.
    """
    ending = path.suffix.lower().lstrip(".")
    kinds = readers()
    if ending not in kinds:
        wish = _INSTEAD.get(ending, "one of " + ", ".join(f".{kind}" for kind in kinds))
        raise InputError(str(path), f"files that end in {path.suffix or 'nothing'!r} are not read", wish)
    readable(path)
    reader = kinds[ending]
    if reader.library:  # a damaged file may send compiled code into a loop
        library(reader.library, path)
        clock = _SECONDS + _SECONDS_PER_MEGABYTE * path.stat().st_size / 2**20
        found, told = in_own_process(_read_compiled, path.resolve(), options, seconds=clock)
        vars(notes).update(vars(told))
        return cast(Drawing | Solids, found)
    assert reader.read is not None
    return reader.read(path, options, notes)
