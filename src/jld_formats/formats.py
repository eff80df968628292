"""File formats as data: how each is read and written, and what a file of it keeps."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, Final, Literal

from jld_core import InputError, Layout, ParameterError, files, parameters, plugins
from jld_core.scene import units
from jld_formats.drawn_loads import Drawing
from jld_formats.options import ImportOptions, Notes
from jld_formats.solids import Solids

Read = Callable[[Path, ImportOptions, Notes], Drawing | Solids]
"""Reader: of a file, options, and notes, which receive what was found and skipped."""

State = tuple[int, bool]
"""Dimension of a scene, and whether every element is written instead of every block."""

PLANAR: Final = frozenset({(2, False), (2, True)})  # both states of planar scenes

OUTLINES: Final = (  # scene keys that the shapes of blocks hold
    "grid",
    "elements.id",
    "elements.polygon",
    "elements.vertices",
    "elements.faces",
    "tolerance",
)

WEIGHTS: Final = ("elements.density", "elements.weight", "elements.volume", "elements.centroid", "materials.density")
"""Scene keys on weights."""

FORCES: Final = tuple(  # scene keys of forces on elements
    f"loads.{where}{kind}.{key}"
    for where in ("", "cases.")
    for kind in ("live", "dead")
    for key in ("element", "force", "at", "moment", "body")
)

OF_BLOCKS: Final = (  # scene keys that a file of blocks with stored values keeps
    *OUTLINES,
    *WEIGHTS,
    *FORCES,
    *("name", "units", "source", "notes", "elements.support", "elements.block", "thickness"),
    *("materials.gravity", "materials.dry", "materials.inner", "loads.cases.name", "loads.cases.required"),
    "loads.pushes",
)


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


_NAMED: Final = (*OUTLINES, "thickness", "name")
_WEIGHED: Final = (*OUTLINES, *WEIGHTS, "thickness", "elements.support")

_OWN: Final = (
    Format(
        "dxf",
        ".dxf",
        by("jld_formats.read_dxf", "read_dxf"),
        ("dxf",),
        write=by("jld_formats.write_drawing", "write_dxf"),
        unit="any",
        whole=PLANAR,
        labels=PLANAR,
    ),
    *(
        Format(
            kind,
            f".{kind}",
            by("jld_formats.read_mesh", "read_mesh"),
            (kind,),
            write=of_text("jld_formats.read_mesh", f"{kind}_text"),
            cells=(2, 3),
            unit="any",
        )
        for kind in ("obj", "stl", "ply")
    ),
    Format(
        "svg",
        ".svg",
        by("jld_formats.read_svg", "read_svg"),
        ("svg",),
        write=of_text("jld_formats.write_drawing", "svg_text"),
        unit="any",
        keeps=(*OUTLINES, "elements.support"),
        labels=PLANAR,
    ),
    Format("csv", "", by("jld_formats.read_mesh", "read_csv"), ("csv",)),
    Format(
        "3dec",
        ".dat",
        write=of_text("jld_formats.write_solids", "command_text"),
        members=False,
        keeps=(*_WEIGHED, "name", "materials.gravity"),
    ),
    Format(
        "3dm",
        ".3dm",
        by("jld_formats.read_rhino", "read_rhino"),
        ("3dm",),
        "rhino3dm",
        by("jld_formats.write_drawing", "write_rhino"),
        cells=(3,),
        unit="any",
        analysed=True,
        keeps=OF_BLOCKS,
        whole=PLANAR | {(3, True)},
        labels=PLANAR,
    ),
    Format(
        "compas",
        ".json",
        by("jld_formats.read_dem", "read_compas"),
        ("json",),
        write=of_text("jld_formats.write_dem", "compas_text"),
        cells=(2, 3),
        members=False,
        keeps=OF_BLOCKS,
        keeps_of_cells=("interfaces",),
        whole=frozenset({(3, True)}),
        labels=frozenset({(2, True), (3, True)}),
    ),
    Format(
        "compas_dem",
        ".json",
        write=of_text("jld_formats.write_dem", "dem_text"),
        cells=(2, 3),
        analysed=True,
        members=False,
        keeps=(*_WEIGHED, *FORCES, "loads.cases.name"),
    ),
    Format(
        "gltf",
        ".glb",
        write=of_text("jld_formats.write_solids", "gltf_bytes"),
        cells=(2, 3),
        unit="metres",
        analysed=True,
        keeps=_NAMED,
    ),
    Format(
        "ifc",
        ".ifc",
        by("jld_formats.read_ifc", "read_ifc"),
        ("ifc",),
        "ifcopenshell",
        by("jld_formats.write_solids", "write_ifc"),
        cells=(2, 3),
        unit="any",
        analysed=True,
        keeps=_NAMED,
    ),
    Format(
        "step",
        ".step",
        by("jld_formats.read_step", "read_step"),
        ("step", "stp", "p21"),
        write=of_text("jld_formats.write_solids", "step_text"),
        cells=(2, 3),
        unit="any",
        keeps=(*_NAMED, "elements.support"),
    ),
    Format("vtk", ".vtu", write=by("jld_formats.write_solids", "write_vtk"), analysed=True, keeps=_NAMED),
)


@cache
def formats() -> dict[str, Format]:
    """Return all formats by name: those of jld, then those of other packages in the order of their names.

    Raises InputError for one of a package that is no `Format` of its name.
    """
    by_name = {format_.name: format_ for format_ in _OWN}
    for name, format_ in plugins.load_all("jld.formats", tuple(by_name)).items():
        if not isinstance(format_, Format) or format_.name != name:
            raise plugins.refuse_type("jld.formats", name, f"a jld_formats.Format with name = {name!r}")
        by_name[name] = format_
    return by_name


class _Written(Mapping[str, str]):
    """Ending of each format that is written, by its name; packages are asked when it is read."""

    def __getitem__(self, name: str) -> str:
        return {key: format_.ending for key, format_ in formats().items() if format_.write is not None}[name]

    def __iter__(self) -> Iterator[str]:
        return (key for key, format_ in formats().items() if format_.write is not None)

    def __len__(self) -> int:
        return sum(1 for _ in self)


FORMATS: Final[Mapping[str, str]] = _Written()
"""Export formats and their file endings."""


def readers() -> dict[str, Format]:
    """Return the format that reads each file ending, without its dot."""
    return {ending: format_ for format_ in formats().values() if format_.read is not None for ending in format_.reads}


def layout_in_unit(layout: Layout, unit: str) -> Layout:
    """Return a layout in another unit of length; ParameterError if either is unknown."""
    # Weights, forces and labels stay as they are. Scene data for re-import and the analysis are taken from
    # `Layout.drawn_from`, the given layout.
    scene_unit = layout.assembly.units[0]
    if unit not in units.METRES:
        raise ParameterError("unit", f"no unit is named {unit!r}", "one of " + ", ".join(units.METRES))
    if scene_unit not in units.METRES:
        raise ParameterError(
            "unit", f"lengths of the scene are in {scene_unit!r}, which is unknown", "units.length of a scene"
        )
    factor = units.METRES[scene_unit] / units.METRES[unit]
    if factor == 1.0:
        return layout
    assembly = layout.assembly
    elements = replace(
        assembly.elements,
        centroid=factor * assembly.elements.centroid,
        volume=factor**3 * assembly.elements.volume,
        shape=tuple(factor * shape for shape in assembly.elements.shape),
    )
    faces = assembly.interfaces
    interfaces = replace(
        faces,
        origin=factor * faces.origin,
        l1=factor * faces.l1,
        l2=factor * faces.l2,
        area=factor**2 * faces.area,
        c_t=factor * faces.c_t,
        polygon=tuple(factor * polygon for polygon in faces.polygon),
    )
    scaled = replace(
        assembly,
        units=(unit, assembly.units[1]),
        elements=elements,
        interfaces=interfaces,
        dead_loads=assembly.dead_loads.stretched(factor),
        live_loads=assembly.live_loads.stretched(factor),
        cases=tuple(
            replace(case, dead_loads=case.dead_loads.stretched(factor), live_loads=case.live_loads.stretched(factor))
            for case in assembly.cases
        ),
    )
    return Layout(layout.scene, scaled, layout.labels, layout.result, layout)


@parameters.typed
def export(layout: Layout, kind: str, path: str | Path, *, cells: bool = False, unit: str | None = None) -> Path:
    """Write a layout to a file of another program, completely or not at all.

    Parameters
    ----------
    layout : Layout
        Layout to write.
    kind : str
        One of FORMATS.
    path : str or Path
        File to write.
    cells : bool
        Write every element as a separate solid, instead of every block, where the format holds solids.
    unit : str, optional
        Length unit of the file ("mm", "in", …) where a file may have one; by default that of the scene.

    Returns
    -------
    Path
        Path of the file.

    Raises
    ------
    InputError
        The format is unknown or does not fit the layout, or a library is missing; or the layout has members
        and an analysis starts from the file.
    """
    path = Path(path)
    if path.is_dir() or not path.absolute().parent.is_dir():
        raise InputError(str(path), "it cannot be written", "a file in a folder that is there")
    if kind not in FORMATS:
        raise ParameterError("format", f"no format is named {kind!r}", "one of " + ", ".join(FORMATS))
    form = formats()[kind]
    dimension = layout.assembly.dimension
    if cells and dimension not in form.cells:
        solids = [name for name in FORMATS if dimension in formats()[name].cells]
        raise ParameterError("cells", f"{kind} draws blocks and the faces inside them", " or ".join(solids))
    if not form.members:  # an analysis starts from the file
        layout.assembly.members.refuse(f"a file of the format {kind}")
    layout = layout.without_members()  # members have no form in any file
    if unit is not None:
        if form.unit != "any":
            problem = f"{kind} has " + ("metres" if form.unit == "metres" else "the units of the scene")
            free = [name for name in FORMATS if formats()[name].unit == "any"]
            raise ParameterError("unit", problem, " or ".join(free))
        layout = layout_in_unit(layout, unit)
    assert form.write is not None
    with files.whole_file(path) as fresh, plugins.guarded("jld.formats", form.name):
        form.write(layout, fresh, cells=cells)
        if not fresh.is_file():
            raise InputError(str(path), f"the writer of {kind} wrote nothing", "one that makes the file")
    return path
