"""Writer of faceted STEP files (ISO 10303-21, AP214): a shell of plane faces per solid."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np

from jld_core import Floats, InputError, Layout, Route, files
from jld_core.build import materials
from jld_core.geometry import area_vector, solids, unions
from jld_core.scene import units
from jld_formats.read_mesh import solids_of

# Prefixes of the metre; other units are conversion based
_PREFIX: Final = {"m": "$", "mm": ".MILLI.", "cm": ".CENTI.", "dm": ".DECI.", "km": ".KILO."}

_SCHEMA: Final = "AUTOMOTIVE_DESIGN { 1 0 10303 214 1 1 1 1 }"  # schema of AP214

_UNCERTAINTY: Final = 1e-9  # stated uncertainty of lengths, relative to the size


def step_text(layout: Layout, *, cells: bool) -> str:
    """Return the text of a STEP file with a solid of plane faces for each block."""
    assembly = layout.assembly
    return step_of_solids(assembly.name, assembly.units[0], assembly.size, solids_of(layout, cells=cells))


def step_of_solids(name: str, unit: str, size: float, solids: Iterable[tuple[str, bool, unions.Surface]]) -> str:
    """Return the text of a STEP file of solids with plane faces.

    Parameters
    ----------
    name : str
        Title of the file.
    unit : str
        Unit of lengths.
    size : float
        Size of all, in that unit.
    solids : iterable of (str, bool, Surface)
        Name, True for a support, closed surface.

    Returns
    -------
    str
        Solids are `MANIFOLD_SOLID_BREP`.
    """
    file = _Part21()
    context = file.context(unit, size)
    supports = []
    for title, support, surface in solids:
        solid = file.solid(title, surface)
        file.product(title, solid, context)
        supports += [solid] * support
    if supports:
        file.add(f"PRESENTATION_LAYER_ASSIGNMENT('supports','',({','.join(supports)}))")
    title = _text(name)
    head = [
        "ISO-10303-21;",
        "HEADER;",
        f"FILE_DESCRIPTION(({title}),'2;1');",
        f"FILE_NAME({title},'1970-01-01T00:00:00',(''),(''),'jld','jld','');",  # the same layout gives the same file
        f"FILE_SCHEMA(('{_SCHEMA}'));",
        "ENDSEC;",
        "DATA;",
    ]
    return "\n".join([*head, *file.lines, "ENDSEC;", "END-ISO-10303-21;"]) + "\n"


def _text(words: str) -> str:
    """Quote a string for ISO 10303-21: apostrophes doubled, non-ASCII characters escaped."""
    plain = files.printable(words).replace("\\", "\\\\").replace("'", "''").replace("\n", " ")
    return "'" + "".join(c if " " <= c <= "~" else f"\\X4\\{ord(c):08X}\\X0\\" for c in plain) + "'"


def _real(value: float) -> str:
    """Return a real number with all digits and a decimal point."""
    text = repr(float(value) + 0.0).upper()
    mantissa, mark, exponent = text.partition("E")
    return (mantissa if "." in mantissa else mantissa + ".") + mark + exponent


def _triple(values: Floats) -> str:
    """Return three real numbers in parentheses."""
    return "(" + ",".join(_real(value) for value in values.tolist()) + ")"


class _Part21:
    """Instances of the data section."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._product_context = ""

    def add(self, words: str) -> str:
        """Add an instance, given as text, and return its reference, such as "#12"."""
        self.lines.append(f"#{len(self.lines) + 1}={words};")
        return f"#{len(self.lines)}"

    def context(self, unit: str, size: float) -> str:
        application = self.add("APPLICATION_CONTEXT('core data for automotive mechanical design processes')")
        self.add(
            "APPLICATION_PROTOCOL_DEFINITION('international standard','automotive_design',2000," + application + ")"
        )
        self._product_context = self.add(f"PRODUCT_CONTEXT('',{application},'mechanical')")
        self._definition_context = self.add(f"PRODUCT_DEFINITION_CONTEXT('part definition',{application},'design')")
        angle = self.add("(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))")
        solid = self.add("(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT())")
        if unit in units.METRES and unit not in _PREFIX:
            metre = self.add("(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT($,.METRE.))")
            measure = self.add(f"LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE({_real(units.METRES[unit])}),{metre})")
            size_of = self.add("DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.)")
            length = self.add(f"(CONVERSION_BASED_UNIT({_text(unit)},{measure})LENGTH_UNIT()NAMED_UNIT({size_of}))")
        else:
            length = self.add(f"(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT({_PREFIX.get(unit, '$')},.METRE.))")
        near = self.add(
            f"UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE({_real(_UNCERTAINTY * size)}),{length},"
            "'distance_accuracy_value','')"
        )
        return self.add(
            f"(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT(({near}))"
            f"GLOBAL_UNIT_ASSIGNED_CONTEXT(({length},{angle},{solid}))REPRESENTATION_CONTEXT('',''))"
        )

    def product(self, name: str, solid: str, context: str) -> None:
        origin = self._placement(np.zeros(3), np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]))
        title = _text(name)
        shape = self.add(f"ADVANCED_BREP_SHAPE_REPRESENTATION({title},({origin},{solid}),{context})")
        product = self.add(f"PRODUCT({title},{title},'',({self._product_context}))")
        self.add(f"PRODUCT_RELATED_PRODUCT_CATEGORY('part',$,({product}))")
        formation = self.add(f"PRODUCT_DEFINITION_FORMATION('','',{product})")
        definition = self.add(f"PRODUCT_DEFINITION('design','',{formation},{self._definition_context})")
        form = self.add(f"PRODUCT_DEFINITION_SHAPE('','',{definition})")
        self.add(f"SHAPE_DEFINITION_REPRESENTATION({form},{shape})")

    def _point(self, place: Floats) -> str:
        """Add a point (3,) and return its reference."""
        return self.add(f"CARTESIAN_POINT('',{_triple(place)})")

    def _direction(self, vector: Floats) -> str:
        """Add the direction of a vector (3,), and return its reference."""
        return self.add(f"DIRECTION('',{_triple(vector / np.linalg.norm(vector))})")

    def _placement(self, place: Floats, axis: Floats, along: Floats) -> str:
        """Add a frame by origin, axis and first direction, (3,) each; return its reference."""
        return self.add(f"AXIS2_PLACEMENT_3D('',{self._point(place)},{self._direction(axis)},{self._direction(along)})")

    def solid(self, name: str, surface: unions.Surface) -> str:
        """Add a solid with plane faces, and return its reference."""
        # Each edge is shared by the two faces that meet in it.
        places = [self._point(point) for point in surface.points]
        vertices = [self.add(f"VERTEX_POINT('',{place})") for place in places]
        edges: dict[tuple[int, int], str] = {}
        faces = []
        for loop in surface.faces:
            ring = list(loop)
            oriented = []
            for a, b in zip(ring, ring[1:] + ring[:1], strict=True):
                key = (min(a, b), max(a, b))
                if key not in edges:
                    along = surface.points[key[1]] - surface.points[key[0]]
                    length = float(np.linalg.norm(along))
                    vector = self.add(f"VECTOR('',{self._direction(along)},{_real(length)})")
                    line = self.add(f"LINE('',{places[key[0]]},{vector})")
                    edges[key] = self.add(f"EDGE_CURVE('',{vertices[key[0]]},{vertices[key[1]]},{line},.T.)")
                sense = ".T." if (a, b) == key else ".F."
                oriented.append(self.add(f"ORIENTED_EDGE('',*,*,{edges[key]},{sense})"))
            corners = surface.points[ring]
            bound = self.add(
                f"FACE_OUTER_BOUND('',{self.add('EDGE_LOOP(' + chr(39) * 2 + ',(' + ','.join(oriented) + '))')},.T.)"
            )
            frame = self._placement(corners[0], area_vector(corners), corners[1] - corners[0])
            plane = self.add(f"PLANE('',{frame})")
            faces.append(self.add(f"ADVANCED_FACE('',({bound}),{plane},.T.)"))
        shell = self.add(f"CLOSED_SHELL('',({','.join(faces)}))")
        return self.add(f"MANIFOLD_SOLID_BREP({_text(name)},{shell})")


_ROUTE: Final = Route("files of 3DEC")


def command_text(layout: Layout, *, cells: bool = False) -> str:
    """Return 3DEC commands that create elements, join those of a block, and set properties.

    Joint stiffnesses are no part of a scene; the first lines define them for the user to edit.
    """
    assembly = layout.assembly
    elements, strengths = assembly.elements, assembly.strengths(_ROUTE)
    length, force = assembly.units
    vector = materials.gravity_vector(layout.scene.materials, assembly.dimension).tolist()
    vector = [vector[0], 0.0, vector[1]] if assembly.dimension == 2 else vector
    lines = [
        f"; {assembly.name}",
        f"; lengths in {length}, forces in {force}; written by jld",
        "; stiffnesses are no part of the model: set them to those of your joints",
        "model new",
        "fish define joint_stiffness",
        "  global _kn = 1e10",
        "  global _ks = 5e9",
        "end",
        "[joint_stiffness]",
        "",
    ]
    for k, name in enumerate(elements.ids):
        surface = _surface(layout, k)
        if not _convex(surface):
            raise InputError(f"element {name!r}", "it is not convex, as a block of 3DEC must be", "jld refine first")
        block = layout.blocks[int(layout.block_of[k])]
        lines.append(f"block create polyhedron group '{_word(block.name)}' ...")
        loops = [[surface.points[index] for index in loop[::-1]] for loop in surface.faces]
        rows = ["  face " + " ".join(f"({x:.12g},{y:.12g},{z:.12g})" for x, y, z in loop) for loop in loops]
        lines += [row + " ..." for row in rows[:-1]] + [rows[-1]]
    lines.append("")
    for block in layout.blocks:
        if len(block.elements) > 1:
            lines.append(f"block join range group '{_word(block.name)}'")
    for block in layout.blocks:
        if block.cells and block.volume > 0.0:
            density = block.mass / block.volume
            lines.append(f"block property density {density:.9g} range group '{_word(block.name)}'")
        else:
            lines.append(f"block fix range group '{_word(block.name)}'")
    usual = {field: _median(getattr(strengths, field)) for field in ("friction", "tension", "shear")}
    lines += [
        "",
        "block contact jmodel assign mohr",
        "block contact property stiffness-normal [_kn] stiffness-shear [_ks] ...",
        f"  friction {np.degrees(np.arctan(usual['friction'])):.9g} cohesion 0 tension 0",
        "block contact material-table default property stiffness-normal [_kn] stiffness-shear [_ks] ...",
        f"  friction {np.degrees(np.arctan(usual['friction'])):.9g} cohesion 0 tension 0",
        "; cells of one block are joined for good; to let inner faces crack, leave out the joins and give them",
        f";   tension {usual['tension']:.9g}, cohesion {usual['shear']:.9g}, friction 0",
        f"model gravity ({vector[0]:.9g},{vector[1]:.9g},{vector[2]:.9g})",
    ]
    return "\n".join(lines) + "\n"


def _surface(layout: Layout, k: int) -> unions.Surface:
    """Return the closed surface of an element."""
    elements = layout.assembly.elements
    if layout.assembly.dimension == 2:
        return unions.extrude(unions.union_outlines([elements.shape[k]])[0], layout.thickness)
    vertices, faces, _, _ = solids([elements.ids[k]], [elements.shape[k]], [elements.faces[k]])
    return unions.union_solids(vertices, faces)


def _convex(surface: unions.Surface) -> bool:
    """Return True if all points of a surface lie behind each of its faces."""
    points = surface.points
    size = float(np.ptp(points, axis=0).max())
    for loop in surface.faces:
        corners = points[list(loop)]
        normal = area_vector(corners)
        normal /= np.linalg.norm(normal)
        if ((points - corners.mean(axis=0)) @ normal).max() > 1e-5 * size:
            return False
    return True


def _median(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else 0.0


def _word(name: str) -> str:
    """Replace apostrophes in a name by underscores."""
    return name.replace("'", "_")
