"""Optional libraries of some formats, and checks of input files."""

from __future__ import annotations

import codecs
import concurrent.futures
import gc
import multiprocessing
import os
import pickle
import signal
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from types import NoneType
from typing import Any, Final, cast

from jld_core import InputError, parameters, plugins
from jld_formats.drawing import planar_scene
from jld_formats.formats import Format, readers
from jld_formats.options import Imported, ImportOptions, Notes
from jld_formats.solids import Solids, spatial_scene

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
    """Import an optional library; InputError names the extra to install where it is missing."""
    try:
        return import_module(name)
    except ImportError:
        raise InputError(
            str(path), f"files of this kind need {name}, which is not installed", f"pip install 'jld[{EXTRAS[name]}]'"
        ) from None


def readable(path: Path) -> Path:
    """Return the path of a file that exists, is not empty and has at most 64 MB; InputError for others."""
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
    """Return the content of a text file without byte order mark; InputError as `readable`."""
    try:
        return decoded(readable(path).read_bytes()).replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError:
        raise InputError(str(path), "it is no text", "a text in UTF-8, UTF-16 or Windows-1252") from None


def decoded(data: bytes, errors: str = "strict") -> str:
    """Return the text of a file: UTF-8, UTF-16 by its mark, or what older programs write on Windows."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16", errors)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors)


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
    """Convert any exception inside this context but InputError to one, for a file that cannot be parsed."""
    try:
        yield
    except InputError:
        raise
    except RecursionError:
        raise InputError("", "it is nested too deeply", expected) from None
    except Exception as error:
        raise InputError(
            "", f"it is no {kind} that can be read: it is damaged, or of another kind", expected
        ) from error


def store_result(path: str, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    """Write the result of a call, or what it raised, to a file."""
    try:
        result = function(*arguments)
    except BaseException as error:
        result = error
    Path(path).write_bytes(pickle.dumps(result))


def in_own_process(
    function: Callable[..., Any], *arguments: Any, seconds: float, watch: Callable[[], str] = str
) -> Any:
    """Call a function of a module in a process of its own; watch: returns in words how far the call is."""
    # A library of compiled code that a damaged file sends into a loop, or to its end, cannot be stopped otherwise.
    with tempfile.TemporaryDirectory(prefix="jld-") as folder:
        target = Path(folder) / "made"
        # whether a copy of this process may read: one made beside a running thread waits for ever for its locks
        may_copy = sys.platform == "linux" and threading.current_thread() is threading.main_thread()
        child = (_fork if may_copy else _sent)(target, function, arguments)
        end = time.monotonic() + seconds
        try:
            while (seconds_left := end - time.monotonic()) > 0.0 and not child(min(seconds_left, _POLL)):
                watch()
            if seconds_left <= 0.0:
                remedy = "more `seconds`, or a part of it: `layer`, `skip`"
                raise InputError("", f"reading it does not end in {seconds:.3g} s{watch()}", remedy)
        finally:
            child(None)
        if not target.exists() or not target.stat().st_size:
            expected = "a file that its program opens and saves again"
            raise InputError("", "its reader broke down: it is damaged", expected)
        result = pickle.loads(target.read_bytes())
    if isinstance(result, BaseException):
        raise result
    return result


_POLL: Final = 0.1  # time between two looks at a reading process, s

# A started process: waits for its end for some time, and returns True at its end; None ends it
_Child = Callable[[float | None], bool]


def _fork(target: Path, function: Callable[..., Any], arguments: tuple[Any, ...]) -> _Child:
    """Begin to call a function in a copy of this process, which has all modules loaded."""
    child = multiprocessing.get_context("fork").Process(target=store_result, args=(str(target), function, arguments))
    with warnings.catch_warnings():
        # such as the thread in which a notebook listens, which holds no lock while its cell runs
        warnings.simplefilter("ignore", DeprecationWarning)
        child.start()

    def wait(seconds: float | None) -> bool:
        if seconds is None:
            child.kill()
        child.join(seconds)
        return not child.is_alive()

    return wait


def _sent(target: Path, function: Callable[..., Any], arguments: tuple[Any, ...]) -> _Child:
    """Begin to call a function in a process that has read other files, or in a new one."""
    from joblib.externals.loky import ProcessPoolExecutor

    while _idle:  # a process takes a second to begin: the next file has it again, unless somebody ended it
        executor = _idle.pop()
        with suppress(BrokenExecutor):
            executor.submit(os.getpid).result()
            break
        executor.shutdown(kill_workers=True)
    else:
        executor = ProcessPoolExecutor(1, initializer=signal.signal, initargs=_UNDISTURBED)
    future = executor.submit(store_result, str(target), function, arguments)

    def wait(seconds: float | None) -> bool:
        if seconds is not None:
            return bool(concurrent.futures.wait([future], seconds).done)
        if future.done() and future.exception() is None:
            _idle.append(executor)
        else:
            executor.shutdown(kill_workers=True)
        return True

    return wait


_idle: Final[list[Any]] = []  # pools of one process each that wait for a file

_UNDISTURBED: Final = (signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends this process, and this process ends the others


@parameters.typed
def import_file(
    path: str | Path,
    options: ImportOptions | None = None,
    *,
    feet: bool = False,
    progress: Callable[[str, int, int], None] | None = None,
) -> Imported:
    """Convert a file of another program to a scene document, by the ending of its name.

    Parameters
    ----------
    path : str or Path
        File to read; its ending is one of `formats.readers`.
    options : ImportOptions, optional
        How the file is read.
    feet : bool
        Supports are added below the lowest edges or faces where the file names none, as for a design.
    progress : Callable, optional
        Called while it is read: what is read, how many of it so far, and of how many, 0 if unknown.

    Returns
    -------
    Imported
        Scene document for `parse_scene`, and a report of what was found, snapped, assumed and skipped.

    Raises
    ------
    InputError
        The file is broken, excessive, of an unknown kind, holds no possible scene, or is not read in time.
    """
    parameters.require_kind("path", path, os.PathLike)
    parameters.require_kind("options", options, ImportOptions, NoneType)
    path, options = Path(path), options or ImportOptions()
    reader = reader_of(path)
    if reader.library:
        library(reader.library, path)
    megabytes = path.stat().st_size / 2**20
    in_process = sys.platform == "linux" or reader.library or megabytes > _SMALL
    if not in_process or multiprocessing.current_process().daemon:  # such a process may have none of its own
        with reading(path):
            return _converted(path, options, Notes(), feet)
    seconds = _SECONDS + _SECONDS_PER_MEGABYTE * megabytes if options.seconds is None else options.seconds
    with reading(path), tempfile.TemporaryDirectory(prefix="jld-") as folder:
        notes = Notes(told=Path(folder) / "told")

        def watch() -> str:
            subject, done, total = notes.last_told()
            if progress is not None and subject:
                progress(subject, done, total)
            return f", {done} {f'of {total} ' if total else ''}{subject} so far" if subject else ""

        arguments = (path.absolute(), options, notes, feet)
        return cast(Imported, in_own_process(_converted, *arguments, seconds=seconds, watch=watch))


_SECONDS: Final = 60.0  # time in which a file must be read, s, beside that for its size

_SECONDS_PER_MEGABYTE: Final = 5.0  # further time for each megabyte of a file, s

_SMALL: Final = 1.0  # size, MB, up to which a file is read in this process where processes cannot be copied


def _converted(path: Path, options: ImportOptions, notes: Notes, feet: bool) -> Imported:
    reader = reader_of(path)
    read = reader.read
    assert read is not None
    with plugins.guarded("jld.formats", reader.name), without_collection():
        content = read(path, options, notes)
        convert = spatial_scene if isinstance(content, Solids) else planar_scene
        return convert(content, options, notes, feet=feet)  # type: ignore[arg-type]


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Make errors about the content of a file name that file; those about options stay."""
    try:
        yield
    except InputError as error:
        where = error.where.removeprefix(str(path.absolute()))  # its reader may stand in another folder
        if where != error.where:
            error = InputError(f"{path}{where}", error.problem, error.expected)
        stays = error.parameter or error.where.startswith(str(path))
        raise (error if stays else error.within(str(path))) from error.__cause__


def reader_of(path: Path) -> Format:
    """Return the format that reads a file by the ending of its name; InputError for an unknown kind."""
    ending = path.suffix.lower().lstrip(".")
    kinds = readers()
    if ending not in kinds:
        expected = _INSTEAD.get(ending, "one of " + ", ".join(f".{kind}" for kind in kinds))
        raise InputError(str(path), f"files that end in {path.suffix or 'nothing'!r} are not read", expected)
    readable(path)
    return kinds[ending]
