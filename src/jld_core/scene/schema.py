"""Keys of a scene file, with types and defaults; docs/scene_keys.md has the meaning of each."""

from __future__ import annotations

import hashlib
import json
from typing import Annotated, Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from jld_core.errors import InputError
from jld_core.notebook_repr import Showable
from jld_core.scene.cracks import FORMS, CrackModel, cracks_by_kind
from jld_core.scene.design import Design
from jld_core.scene.loads import Loads, Settling, require_unique_names
from jld_core.scene.materials import Fill, Materials
from jld_core.scene.move import Move
from jld_core.scene.part import (
    Angle,
    LabelName,
    Member,
    NonNegative,
    Pair,
    Part,
    Positive,
    PositiveValue,
    Value,
    Vector,
    Weighing,
)
from jld_core.scene.search import Labels, Search


class Units(Part):
    """Names of the units of length and force; no number is converted."""

    length: str = "m"
    force: str = "N"


class Grid(Part):
    """Planar cells, given as rows of letters from top to bottom.

    '.' no cell, '#' a support, connected equal letters one block.
    """

    cell: Annotated[list[Positive], Field(min_length=2, max_length=2, description="[width, height] of a cell")]
    thickness: Positive = 1.0
    rows: Annotated[list[str], Field(min_length=1, description="a list of texts, the top row first")]

    @field_validator("rows")
    @classmethod
    def _rows_are_a_rectangle(cls, rows: list[str]) -> list[str]:
        """Check that rows have equal length, valid characters and a free cell."""
        for index, row in enumerate(rows):
            if len(row) != len(rows[0]):
                raise InputError("", f"row {index} has {len(row)} cells", f"{len(rows[0])} as in row 0")
            if bad := [c for c in row if c not in ".#" and not c.isalpha()]:
                raise InputError("", f"row {index} holds {bad[0]!r}", "letters, '#' or '.'")
        if not any(c.isalpha() for row in rows for c in row):
            raise InputError("", "no free cell", "at least one letter")
        return rows


class Element(Part):
    """Rigid element: a polygon (planar), or vertices and faces (spatial).

    Weight, density, volume and centroid override computed ones. faces: loops of vertex indices from 0. block: elements
    of equal name form one block.
    """

    id: Annotated[str, Field(min_length=1, description="a name of its own")]
    polygon: Annotated[list[Annotated[list[float], Field(min_length=2, max_length=2)]], Field(min_length=3)] | None = (
        None
    )
    vertices: Annotated[list[Annotated[list[float], Field(min_length=3, max_length=3)]], Field(min_length=4)] | None = (
        None
    )
    faces: Annotated[list[Annotated[list[int], Field(min_length=3)]], Field(min_length=4)] | None = None
    weight: Weighing | None = None
    density: Weighing | None = None
    volume: Positive | None = None
    centroid: Vector | None = None
    block: str | None = None
    support: bool = False

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        """Check that exactly one form of geometry is given, with valid indices and dimensions."""
        if (self.polygon is None) == (self.vertices is None):
            which = "both are" if self.polygon is not None else "neither is"
            expected = '"polygon", or "vertices" with "faces"'
            raise InputError("", f'of "polygon" and "vertices" {which} given', expected)
        if (self.vertices is None) != (self.faces is None):
            key = "faces" if self.vertices is None else "vertices"
            raise InputError("", f'"{key}" is given alone', '"vertices" and "faces" together, or "polygon"')
        if self.vertices is not None and self.faces is not None:
            for face in self.faces:
                if bad := [i for i in face if not 0 <= i < len(self.vertices)]:
                    raise InputError(
                        ".faces", f"a face names vertex {bad[0]}", f"numbers from 0 to {len(self.vertices) - 1}"
                    )
        dimension = 2 if self.polygon is not None else 3
        if self.centroid is not None and len(self.centroid) != dimension:
            raise InputError(".centroid", f"it has {len(self.centroid)} numbers", f"{dimension}")
        return self


class Contact(Part):
    """Interface stated in the scene, used without contact detection; its strengths override "materials".

    Friction and cohesion are those of the dry joint, tension and shear of the inner face, compression of both.
    """

    elements: Annotated[Pair, Field(description="[id, id] of the two elements")]
    polygon: Annotated[list[Vector], Field(min_length=2, description="two points [x, y], or a spatial polygon")]
    label: LabelName | None = None
    friction_coefficient: Value | None = None
    friction_angle: Angle | None = None
    tensile_strength: Value | None = None
    shear_strength: Value | None = None
    compressive_strength: PositiveValue | None = None
    cohesion: Value | None = None
    inner_friction_coefficient: Value | None = None
    inner_friction_angle: Angle | None = None

    @model_validator(mode="after")
    def _one_friction(self) -> Self:
        for name in ("friction", "inner_friction"):
            if getattr(self, f"{name}_angle") is not None and getattr(self, f"{name}_coefficient") is not None:
                raise InputError("", "friction is given twice", f'"{name}_angle" or "{name}_coefficient"')
        return self


class Scene(Part, Showable):
    """Validated scene file; geometry is given as either "grid" or "elements".

    Attributes
    ----------
    name : str
        Heading of tables and figures.
    units : Units
        Names of the units of length and force.
    source, notes, expected : str, str, dict
        Free content that no computation reads.
    grid : Grid or None
        Planar cells.
    elements : list of Element or None
        Elements, all planar or all spatial.
    thickness : float or None
        Out-of-plane depth of planar elements; 1 where absent.
    tolerance : float or None
        Length up to which gaps and overlaps are closed; None for the default.
    interfaces : list of Contact or None
        Stated interfaces; None to detect contacts.
    materials : Materials
        Weights and strengths.
    loads : Loads
        Dead and live loads, or load cases.
    members : list of Member
        Ties, tendons and pins.
    fill : Fill or None
        Soil on a planar structure.
    settlements : list of Settling
        Movements of supports.
    labels : Labels
        The scene's own labelling.
    search : Search
        Candidates, limits and objectives of a search.
    cracks : "faces", CellCracks or FieldCracks
        Crack model of the blocks.
    move : Move or None
        Joints that `jld move` moves, and their limits.
    design : Design or None
        Partial factors of the design check; None for the default set.
    """

    name: Annotated[str, Field(min_length=1)] = "scene"
    units: Units = Units()
    source: str = ""
    notes: str = ""
    expected: dict[str, Any] = {}
    grid: Grid | None = None
    elements: Annotated[list[Element], Field(min_length=1)] | None = None
    thickness: Positive | None = None
    tolerance: NonNegative | None = None
    interfaces: list[Contact] | None = None
    materials: Annotated[Materials, Field(description='an object with "dry", "inner" or both')]
    loads: Annotated[Loads, Field(description='an object with "live"')]
    members: list[Member] = []
    fill: Fill | None = None
    settlements: list[Settling] = []
    labels: Labels = Labels()
    search: Search = Search()
    cracks: Annotated[CrackModel, Field(description=FORMS)] = "faces"
    move: Move | None = None
    design: Design | None = None

    _crack_model = field_validator("cracks", mode="before")(cracks_by_kind)

    @model_validator(mode="after")
    def _one_geometry(self) -> Self:
        """Check that the geometry is given once, in one dimension, and that names are unique."""
        if (self.grid is None) == (self.elements is None):
            state = "missing" if self.grid is None else "given twice"
            raise InputError("", f"the geometry is {state}", 'exactly one of "grid" and "elements"')
        if self.grid is not None and self.thickness is not None:
            raise InputError(".thickness", 'it is given together with "grid"', 'the thickness inside "grid"')
        if self.loads.tilts:
            has_force = {"fill": self.fill is not None, "members": any(member.prestress for member in self.members)}
            for key in (key for key, present in has_force.items() if present):
                raise InputError(f".{key}", "it has forces that do not turn on a tilting table", "no tilt")
        require_unique_names(".settlements", [settlement.name for settlement in self.settlements])
        require_unique_names(".members", [member.name for member in self.members if member.name is not None])
        if self.elements is not None:
            planar = [element.polygon is not None for element in self.elements]
            if any(planar) and not all(planar):
                position = planar.index(not planar[0])
                kinds = ("planar", "spatial") if planar[0] else ("spatial", "planar")
                raise InputError(
                    f".elements[{position}]",
                    f"it is {kinds[1]} and the ones before are {kinds[0]}",
                    "elements of one dimension",
                )
        return self

    def __repr__(self) -> str:
        return f"Scene({self.name!r}, {'planar' if self.dimension == 2 else 'spatial'})"

    @property
    def dimension(self) -> Literal[2, 3]:
        return 3 if self.elements is not None and self.elements[0].polygon is None else 2

    @property
    def plane_thickness(self) -> float:
        """Return the out-of-plane thickness, a length: that of the grid, else of the scene, else 1."""
        return self.grid.thickness if self.grid is not None else (self.thickness or 1.0)

    @property
    def fingerprint(self) -> str:
        """Return the hex digest of all keys that results depend on; records of a search are found by it."""
        content = self.model_dump(mode="json", exclude={"name", "source", "notes", "expected", "move", "design"})
        if not self.members:  # scenes without members keep the digest that they had before there were any
            del content["members"]
        if self.fill is None:
            del content["fill"]
        if self.loads.pushes is None:
            del content["loads"]["pushes"]
        sides = [content["materials"], *content["materials"]["faces"]]
        for material in [side[label] for side in sides for label in ("dry", "inner") if side[label] is not None]:
            if material["surface"] is None:
                del material["surface"]
        joints = [side["dry"] for side in sides]
        for joint in joints:  # the same for joints without bond
            if joint is not None and not joint["tensile_strength"]:
                del joint["tensile_strength"]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
