"""Keys of labels and of a search: candidates, limits and objectives."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import ConfigDict, Field, field_validator, model_validator

from jld_core import tolerances
from jld_core.errors import InputError
from jld_core.scene.part import LabelName, NonNegative, Pair, Part, Positive


class Labels(Part):
    """The scene's own labelling: pairs of elements by label, and the label of all other faces.

    default: None for inner between elements of one named block, else dry.
    """

    default: LabelName | None = None
    inner: list[Pair] = []
    dry: list[Pair] = []


class Keep(Part):
    """Faces that keep a label in a search, given by pairs of elements."""

    dry: list[Pair] = []
    inner: list[Pair] = []


def _require_order(bounds: list[Any]) -> list[Any]:
    """Return bounds [least, most]; raise InputError if they are reversed."""
    low, high = bounds
    if low is not None and high is not None and low > high:
        raise InputError("", f"the least, {low:g}, is above the most, {high:g}", "[least, most]")
    return bounds


Counts = Annotated[list[Annotated[int, Field(ge=0)] | None], Field(min_length=2, max_length=2)]
"""Bounds [least, most] of a count, None for no limit."""

Sizes = Annotated[list[NonNegative | None], Field(min_length=2, max_length=2)]
"""Bounds [least, most] of a measured quantity, None for no limit."""

Sense = Literal["max", "min"]  # better direction of a count


class Front(Part):
    """Counts of a layout, such as dry faces, that a search optimises together with λ."""

    count: Annotated[str, Field(min_length=1)] = "dry_faces"
    counts: Annotated[list[str] | None, Field(min_length=2, max_length=2, description="two names of counts")] = None
    sense: Annotated[Sense | list[Sense], Field(description='"max" or "min", or one of them for each count')] = "max"

    @model_validator(mode="before")
    @classmethod
    def _first_of_counts(cls, document: Any) -> Any:
        # the count is the first of "counts" where only these are given
        if isinstance(document, dict) and isinstance(document.get("counts"), list) and document["counts"]:
            return {"count": document["counts"][0], **document}
        return document

    @model_validator(mode="after")
    def _agree(self) -> Self:
        """Check that count, counts and sense are consistent."""
        if self.counts is not None and self.count != self.counts[0]:
            raise InputError(".count", 'it is given together with "counts"', "one of them")
        if self.counts is not None and self.counts[0] == self.counts[1]:
            raise InputError(".counts", f"{self.count!r} is given twice", "two different counts")
        if isinstance(self.sense, list) and len(self.sense) != len(self.counts or [self.count]):
            raise InputError(".sense", f"it has {len(self.sense)} entries", "one for each count")
        return self

    @property
    def axes(self) -> tuple[tuple[str, Sense], ...]:
        """Return the name and the better direction ("max" or "min") of each count."""
        names = self.counts or [self.count]
        senses = self.sense if isinstance(self.sense, list) else [self.sense] * len(names)
        return tuple(zip(names, senses, strict=True))


class Require(Part):
    """Required load factor of layouts; among those that have it, a search optimises `Front`."""

    load_factor: Positive

    @property
    def threshold(self) -> float:
        """Return the least λ that meets the requirement: `load_factor` less the tolerance of proven bounds."""
        return self.load_factor * (1.0 - tolerances.PROVEN)


class Moulds(Part):
    """Copies of a block's shape that count as the same shape, beside translated ones."""

    rotate: bool = False
    flip: bool = False


class VoidCells(Part):
    """Cells that a search may leave out of the structure."""

    cells: Annotated[Literal["all"] | list[str], Field(description='"all" or a list of ids of free elements')] = "all"
    most: Annotated[float, Field(gt=0, lt=1)] = 0.5


class Search(Part):
    """Candidates, limits and objectives of a search over labellings.

    Bounds are [least, most], None for no limit.

    Attributes
    ----------
    candidates : str or list of pairs of ids
        Faces that may be relabelled: "all", "all+supports", "inside-blocks", or faces between pairs.
    keep : Keep
        Faces that keep their label.
    segmentation : bool
        Require that every dry face separates two blocks (no slits).
    block_cells : [int, int]
        Bounds of the number of free elements per block.
    block_weight, block_mass : [float, float]
        Bounds of the weight and mass of each block.
    block_extent : [float, float]
        Bounds of the extent of each block along any axis, length.
    block_aspect : [float, float]
        Bounds of longest over shortest side of the smallest box around each block.
    except_ : list of str
        Ids of free elements whose blocks are exempt from the bounds on single blocks; key "except".
    convex_blocks : bool or int
        Require convex blocks, or (planar) limit the number of re-entrant corners of each.
    blocks, dry_faces, shapes : [int, int]
        Bounds of the number of blocks with a free element, of dry faces between free elements, and of block shapes.
    sawn_length : [float, float]
        Bounds of the length (in space area) of the faces of all blocks.
    saw_cuts, saw_set_ups : [int, int]
        Bounds of the number of sawn faces of all blocks, and of directions of these faces, summed over shapes.
    limits : dict of str to [float, float]
        Bounds of counts by name: any column of the tables that is a count, those of plug-ins too.
    moulds : Moulds
        Congruence by which shapes are counted.
    require : Require or None
        Required load factor.
    void : VoidCells or None
        Cells that may be left out.
    assemble : {"translation", "standing"} or None
        Required assembly sequence.
    assemble_out_of_plane : bool
        Allow blocks of a planar wall to be laid out of its plane.
    symmetry : {"auto", "none", "mirror-x"}
        Symmetry under which labellings are equivalent.
    front : Front
        Objectives beside λ.
    """

    model_config = ConfigDict(serialize_by_alias=True)

    candidates: Annotated[
        Literal["all", "all+supports", "inside-blocks"] | list[Pair],
        Field(description='"all", "all+supports", "inside-blocks" or a list of pairs of ids'),
    ] = "all"
    keep: Keep = Keep()
    segmentation: bool = True
    block_cells: Counts = [None, None]
    block_weight: Sizes = [None, None]
    block_extent: Sizes = [None, None]
    block_mass: Sizes = [None, None]
    block_aspect: Sizes = [None, None]
    except_: Annotated[list[str], Field(description="a list of ids of free elements")] = Field([], alias="except")
    convex_blocks: Annotated[bool | Annotated[int, Field(ge=0)], Field(description="true, false or a number")] = False
    blocks: Counts = [None, None]
    dry_faces: Counts = [None, None]
    shapes: Counts = [None, None]
    sawn_length: Sizes = [None, None]
    saw_cuts: Counts = [None, None]
    saw_set_ups: Counts = [None, None]
    limits: dict[str, Sizes] = {}
    moulds: Moulds = Moulds()
    require: Require | None = None
    void: VoidCells | None = None
    assemble: Literal["translation", "standing"] | None = None
    assemble_out_of_plane: bool = False
    symmetry: Literal["auto", "none", "mirror-x"] = "auto"
    front: Front = Front()

    _in_order = field_validator(
        "block_cells",
        "block_weight",
        "block_extent",
        "block_mass",
        "block_aspect",
        "blocks",
        "dry_faces",
        "shapes",
        "sawn_length",
        "saw_cuts",
        "saw_set_ups",
    )(_require_order)

    @field_validator("limits")
    @classmethod
    def _limits_in_order(cls, limits: dict[str, list[float | None]]) -> dict[str, list[float | None]]:
        """Check the bounds of each count."""
        for name, bounds in limits.items():
            try:
                _require_order(bounds)
            except InputError as error:
                raise InputError(f".{name}", error.problem, error.expected) from None
        return limits
