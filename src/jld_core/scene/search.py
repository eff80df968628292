"""The keys of labels and of a search: what may be relabelled, under which limits, and what counts."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import ConfigDict, Field, field_validator, model_validator

from jld_core import tolerances
from jld_core.errors import InputError
from jld_core.scene.part import LabelName, NonNegative, Pair, Part, Positive


class Labels(Part):
    default: LabelName | None = None
    inner: list[Pair] = []
    dry: list[Pair] = []


class Keep(Part):
    dry: list[Pair] = []
    inner: list[Pair] = []


def _ordered(bounds: list[Any]) -> list[Any]:
    low, high = bounds
    if low is not None and high is not None and low > high:
        raise InputError("", f"the least, {low:g}, is above the most, {high:g}", "[least, most]")
    return bounds


Counts = Annotated[list[Annotated[int, Field(ge=0)] | None], Field(min_length=2, max_length=2)]
Sizes = Annotated[list[NonNegative | None], Field(min_length=2, max_length=2)]
Sense = Literal["max", "min"]


class Front(Part):
    """What λ is weighed against: one count, or two."""

    count: Annotated[str, Field(min_length=1)] = "dry_faces"
    counts: Annotated[list[str] | None, Field(min_length=2, max_length=2, description="two names of counts")] = None
    sense: Annotated[Sense | list[Sense], Field(description='"max" or "min", or one of them for each count')] = "max"

    @model_validator(mode="before")
    @classmethod
    def _first_of_counts(cls, given: Any) -> Any:
        if isinstance(given, dict) and isinstance(given.get("counts"), list) and given["counts"]:
            return {"count": given["counts"][0], **given}
        return given

    @model_validator(mode="after")
    def _agree(self) -> Self:
        if self.counts is not None and self.count != self.counts[0]:
            raise InputError(".count", 'it stands beside "counts"', "one of them")
        if self.counts is not None and self.counts[0] == self.counts[1]:
            raise InputError(".counts", f"{self.count!r} stands there twice", "two different counts")
        if isinstance(self.sense, list) and len(self.sense) != len(self.counts or [self.count]):
            raise InputError(".sense", f"it has {len(self.sense)} entries", "one for each count")
        return self

    @property
    def axes(self) -> tuple[tuple[str, Sense], ...]:
        """Every count with its better direction."""
        names = self.counts or [self.count]
        senses = self.sense if isinstance(self.sense, list) else [self.sense] * len(names)
        return tuple(zip(names, senses, strict=True))


class Require(Part):
    """What layouts must carry; the best by the front's count is then looked for among those that do."""

    load_factor: Positive

    @property
    def threshold(self) -> float:
        """λ from which the requirement is met, rounding of what is proven allowed for."""
        return self.load_factor * (1.0 - tolerances.PROVEN)


class Moulds(Part):
    """What counts as one shape of block, beside being moved: being turned, being turned over."""

    rotate: bool = False
    flip: bool = False


class VoidCells(Part):
    """Cells that may be left out."""

    cells: Annotated[Literal["all"] | list[str], Field(description='"all" or a list of ids of free elements')] = "all"
    most: Annotated[float, Field(gt=0, lt=1)] = 0.5


class Search(Part):
    """What may be relabelled, and which labellings count."""

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
    )(_ordered)
