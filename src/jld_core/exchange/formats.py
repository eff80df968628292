"""File formats as data: how each is read and written, and what a file of it keeps."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, Final, Literal

from jld_core import plugins
from jld_core.exchange.drawn_loads import Drawing
from jld_core.exchange.layout import Layout
from jld_core.exchange.options import ImportOptions, Notes
from jld_core.exchange.solids import Solids

Read = Callable[[Path, ImportOptions, Notes], Drawing | Solids]
"""Reader: of a file, options, and notes, which receive what was found and skipped."""

State = tuple[int, bool]
"""Dimension of a scene, and whether every element is written instead of every block."""

PLANAR: Final = frozenset({(2, False), (2, True)})
"""Both states of planar scenes."""

OUTLINES: Final = (
    "grid",
    "elements.id",
    "elements.polygon",
    "elements.vertices",
    "elements.faces",
    "tolerance",
)
"""Scene keys that the shapes of blocks hold."""

WEIGHTS: Final = ("elements.density", "elements.weight", "elements.volume", "elements.centroid", "materials.density")
"""Scene keys on weights."""

FORCES: Final = tuple(
    f"loads.{where}{kind}.{key}"
    for where in ("", "cases.")
    for kind in ("live", "dead")
    for key in ("element", "force", "at", "moment", "body")
)
"""Scene keys of forces on elements."""

OF_BLOCKS: Final = (
    *OUTLINES,
    *WEIGHTS,
    *FORCES,
    *("name", "units", "source", "notes", "elements.support", "elements.block", "thickness"),
    *("materials.gravity", "materials.dry", "materials.inner", "loads.cases.name", "loads.cases.required"),
    "loads.pushes",
)
"""Scene keys that a file of blocks with stored values keeps."""


@dataclass(frozen=True)
class Format:
    """A file format (group ``jld.formats``).

    Attributes
    ----------
    name : str
        Name in ``jld export --format``.
    ending : str
        Ending of files that are written, with its dot.
    read : Callable, optional
        Reader, called with a path, `ImportOptions` and `Notes`; returns a `Drawing` or `Solids`.
    reads : tuple of str
        Endings that it reads, without the dot.
    library : str
        Library of compiled code that the reader calls: the file is read in a process of its own, under a clock.
    write : Callable, optional
        Writer, called with a layout, a path, and ``cells``: every element is written, not every block.
    cells : tuple of int
        Dimensions of scenes of which every element can be written.
    unit : "any", "metres" or "scene"
        Unit of lengths in a file: one that is asked for, metres, or that of the scene.
    analysed : bool
        A file holds forces, mechanism or λ: the layout is solved before.
    members : bool
        Layouts with members can be written; False where an analysis starts from the file.
    keeps : tuple of str
        Scene keys that a file keeps, by key or by the keys above it; others are named as lost.
    keeps_of_cells : tuple of str
        Further keys where every element is written.
    whole : frozenset of (int, bool)
        States (dimension, cells) in which a file stores the whole scene.
    labels : frozenset of (int, bool)
        States in which a file shows which faces are inner.
    """

    name: str
    ending: str
    read: Read | None = None
    reads: tuple[str, ...] = ()
    library: str = ""
    write: Callable[..., None] | None = None
    cells: tuple[int, ...] = ()
    unit: Literal["any", "metres", "scene"] = "scene"
    analysed: bool = False
    members: bool = True
    keeps: tuple[str, ...] = OUTLINES
    keeps_of_cells: tuple[str, ...] = ()
    whole: frozenset[State] = field(default=frozenset())
    labels: frozenset[State] = field(default=frozenset())


def by(module: str, function: str) -> Callable[..., Any]:
    """Return a reader, or writer to a path, whose module is imported when it is called."""

    def call(*arguments: Any, **options: Any) -> Any:
        return getattr(import_module(module), function)(*arguments, **options)

    return call


def of_text(module: str, function: str) -> Callable[..., None]:
    """Return a writer by a function of a layout and `cells` that returns the text, or the bytes, of a file."""
    content_of = by(module, function)

    def write(layout: Layout, path: Path, *, cells: bool) -> None:
        content = content_of(layout, cells=cells)
        path.write_bytes(content) if isinstance(content, bytes) else path.write_text(content, encoding="utf-8")

    return write


_OWN: Final = (
    Format(
        "dxf",
        ".dxf",
        by("jld_core.exchange.read_dxf", "read_dxf"),
        ("dxf",),
        write=by("jld_core.exchange.write_drawing", "write_dxf"),
        unit="any",
        whole=PLANAR,
        labels=PLANAR,
    ),
    *(
        Format(
            kind,
            f".{kind}",
            by("jld_core.exchange.read_mesh", "read_mesh"),
            (kind,),
            write=of_text("jld_core.exchange.read_mesh", f"{kind}_text"),
            cells=(2, 3),
            unit="any",
        )
        for kind in ("obj", "stl", "ply")
    ),
    Format(
        "svg",
        ".svg",
        by("jld_core.exchange.read_svg", "read_svg"),
        ("svg",),
        write=of_text("jld_core.exchange.write_drawing", "svg_text"),
        unit="any",
        keeps=(*OUTLINES, "elements.support"),
        labels=PLANAR,
    ),
    Format("csv", "", by("jld_core.exchange.read_csv", "read_csv"), ("csv",)),
)


@cache
def formats() -> dict[str, Format]:
    """Return all formats by name: those of the core, then those of other packages in the order of their names.

    Raises InputError for one of a package that is no `Format` of its name.
    """
    found = {one.name: one for one in _OWN}
    for name, one in plugins.load_all("jld.formats", tuple(found)).items():
        if not isinstance(one, Format) or one.name != name:
            raise plugins.refuse_type("jld.formats", name, f"a jld_core.exchange.Format with name = {name!r}")
        found[name] = one
    return found


class _Written(Mapping[str, str]):
    """Ending of each format that is written, by its name; packages are asked when it is read."""

    def __getitem__(self, name: str) -> str:
        return {key: one.ending for key, one in formats().items() if one.write is not None}[name]

    def __iter__(self) -> Iterator[str]:
        return (key for key, one in formats().items() if one.write is not None)

    def __len__(self) -> int:
        return sum(1 for _ in self)


FORMATS: Final[Mapping[str, str]] = _Written()
"""Export formats and their file endings."""


def readers() -> dict[str, Format]:
    """Return the format that reads each file ending, without its dot."""
    return {ending: one for one in formats().values() if one.read is not None for ending in one.reads}
