"""Import of files by their ending."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, cast

from jld_core.errors import InputError
from jld_core.exchange.drawing import planar_scene
from jld_core.exchange.drawn import Drawing
from jld_core.exchange.formats import readers
from jld_core.exchange.libraries import in_own_process, library, readable
from jld_core.exchange.options import Imported, ImportOptions, Notes
from jld_core.exchange.solids import Solids, spatial_scene


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
    with reading(path):
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
        raise (error if error.where.startswith((str(path), "--")) else error.within(str(path))) from error.__cause__


def read_content(path: Path, options: ImportOptions, notes: Notes) -> Drawing | Solids:
    """Read a file by the ending of its name: the paths of a drawing, or solids.

    notes: receives what was found and skipped. Raises InputError for an unknown kind and what its reader refuses.
    """
    ending = path.suffix.lower().lstrip(".")
    kinds = readers()
    if ending not in kinds:
        known = ", ".join(f".{kind}" for kind in kinds)
        raise InputError(str(path), f"files that end in {path.suffix or 'nothing'!r} are not read", f"one of {known}")
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
