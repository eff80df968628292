"""What each key of a scene file means, and in which unit: the words of the documentation and of editors.

A key that the schema has and this does not, or the other way round, is an error of the tests.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from pydantic import BaseModel

from jld_core.scene import cracks, design, loads, materials, move, schema, search
from jld_core.scene import materials as fill
from jld_core.scene import part as members


class Meaning(NamedTuple):
    """unit: "" for what has none; words of the scene's own units: length, force, stress, mass. text: one sentence."""

    unit: str
    text: str


_FREE: Final = Meaning("", "Free: kept, never read by the solver.")
_FRICTION: Final = Meaning("", "μ of the dry face; instead of `friction_angle`.")
_ANGLE: Final = Meaning("degrees", "Angle of friction of the dry face; instead of `friction_coefficient`.")
_TENSILE: Final = Meaning("stress", "σt of the inner face.")
_SHEAR: Final = Meaning("stress", "τ of the inner face.")
_CRITERION: Final = {
    "criterion": Meaning("", "Name of a criterion that an installed package adds, in place of the standard strengths."),
    "parameters": Meaning("", "Parameters of the criterion, scene units."),
    "surface": Meaning("", "Yield surface in place of the standard strengths, see docs/guide/yield_surfaces.md."),
}
_CRUSHING: Final = Meaning("stress", "σc of the face; without it nothing is crushed.")
_COHESION: Final = Meaning("stress", "Shear strength of a dry face where nothing presses it: c + μ N/A.")
_BOND: Final = Meaning(
    "stress", "σt of dry faces, their bond; at most c/μ, and at most σt of the face as an inner one."
)

MEANINGS: Final[dict[type[BaseModel], dict[str, Meaning]]] = {
    schema.Scene: {
        "name": Meaning("", "What tables and pictures are headed by."),
        "units": Meaning("", "Words for tables and axes; the numbers are whatever the file says, consistently."),
        "source": _FREE,
        "notes": _FREE,
        "expected": _FREE,
        "grid": Meaning("", "Planar cells; either this or `elements`."),
        "elements": Meaning("", "General elements, all planar or all spatial; either this or `grid`."),
        "thickness": Meaning("length", "Depth of planar elements out of the plane; 1 where it is not given."),
        "tolerance": Meaning(
            "length",
            "Gaps and overlaps up to it are closed by moving corners; 1e-4 of the shortest edge where it is not given, "
            "0 closes none. Grids and stated interfaces are left as they are.",
        ),
        "interfaces": Meaning(
            "", "Given, they are used as they are, on faces of both elements; else they are found where elements touch."
        ),
        "materials": Meaning("", "Weight and strengths of all elements and faces."),
        "loads": Meaning("", "Dead loads beside self-weight, and the live load that λ multiplies."),
        "members": Meaning("", "Ties, tendons and pins between points of elements; they have no label."),
        "fill": Meaning("", "Soil on a planar structure, such as the fill of a bridge."),
        "settlements": Meaning("", "Movements of supports, for `jld settlement`."),
        "labels": Meaning("", "The scene's own labelling; else blocks decide: inner within one, dry between two."),
        "search": Meaning("", "What `jld explore` may relabel, and which layouts count."),
        "cracks": Meaning("", "How blocks crack: along faces of the grid, of finer cells, or anywhere by fields."),
        "move": Meaning("", "Which vertices of joints `jld move` moves, within which limits, and to what end."),
        "design": Meaning("", "Partial factors of `jld check-design`; EN 1996-1-1 where it is not given."),
    },
    schema.Units: {
        "length": Meaning("", "The unit of length, in words."),
        "force": Meaning("", "The unit of force, in words."),
    },
    schema.Grid: {
        "cell": Meaning("length", "Width and height of a cell."),
        "thickness": Meaning("length", "Depth of the cells out of the plane."),
        "rows": Meaning(
            "",
            "Cells as they are seen, the top row first: `.` no cell, `#` a support, a letter a cell; equal letters "
            "that touch are one block. Cells are named `c{column}r{row}`, row 0 at the top; the lower left corner is "
            "the origin.",
        ),
    },
    schema.Element: {
        "id": Meaning("", "A name of its own."),
        "polygon": Meaning("length", "Corners of a planar element."),
        "vertices": Meaning("length", "Corners of a spatial element."),
        "faces": Meaning("", "Faces of a spatial element, each a list of places in `vertices`, counted from 0."),
        "weight": Meaning("force", "Its weight; wins over a density."),
        "density": Meaning("mass/length³", "Its own density; wins over that of `materials`."),
        "volume": Meaning("length³", "Used instead of the computed one."),
        "centroid": Meaning("length", "Used instead of the computed one."),
        "block": Meaning("", "Elements of one name are one block; else the element is a block of its own."),
        "support": Meaning("", "A support does not move."),
    },
    schema.Contact: {
        "elements": Meaning("", "Ids of the two elements."),
        "polygon": Meaning("length", "Corners of the face: two points in the plane, a plane polygon in space."),
        "label": Meaning("", "Label of this face."),
        "friction_coefficient": _FRICTION,
        "friction_angle": _ANGLE,
        "tensile_strength": _TENSILE,
        "shear_strength": _SHEAR,
        "compressive_strength": _CRUSHING,
        "cohesion": _COHESION,
        "inner_friction_coefficient": Meaning("", "μ of this face as an inner one; that of `inner` where absent."),
        "inner_friction_angle": Meaning("degrees", "The same as an angle."),
    },
    materials.Materials: {
        "density": Meaning("mass/length³", "Of all elements without one of their own; times `gravity` it is a weight."),
        "gravity": Meaning(
            "length/s²",
            "A number, along −y in the plane and −z in space, or a vector; its direction is that of given weights too.",
        ),
        "dry": Meaning("", "Joints between blocks; needed where a face can be dry."),
        "inner": Meaning("", "Crack planes inside blocks; needed where a face can be inner."),
        "faces": Meaning("", "Values of the faces between two elements, in the place of those above."),
    },
    materials.FaceMaterial: {
        "between": Meaning(
            "", "Ids of two elements that touch; the entry is for all their faces, one entry for each pair."
        ),
        "dry": Meaning("", "Values as joints; what is left out is that of `materials.dry`."),
        "inner": Meaning("", "Values as crack planes; what is left out is that of `materials.inner`."),
    },
    materials.DryFace: {
        **_CRITERION,
        "friction_angle": _ANGLE,
        "friction_coefficient": _FRICTION,
        "compressive_strength": _CRUSHING,
        "cohesion": _COHESION,
        "tensile_strength": _BOND,
    },
    materials.InnerFace: {
        **_CRITERION,
        "tensile_strength": _TENSILE,
        "shear_strength": _SHEAR,
        "compressive_strength": _CRUSHING,
        "friction_angle": Meaning("degrees", "Angle of friction of cracks."),
        "friction_coefficient": Meaning("", "μ of cracks; σt is at most τ/μ."),
    },
    materials.Dry: {
        **_CRITERION,
        "friction_angle": Meaning("degrees", "Angle of friction; exactly one of this and `friction_coefficient`."),
        "friction_coefficient": Meaning("", "μ, the tangent of the angle of friction."),
        "compressive_strength": _CRUSHING,
        "cohesion": _COHESION,
        "tensile_strength": _BOND,
    },
    materials.Inner: {
        **_CRITERION,
        "tensile_strength": Meaning("stress", "σt, the elastic edge stress at which a crack opens."),
        "shear_strength": Meaning("stress", "τ, the mean shear stress at which a crack slides."),
        "compressive_strength": _CRUSHING,
        "friction_angle": Meaning("degrees", "Angle of friction of cracks; 0 where neither it nor μ is given."),
        "friction_coefficient": Meaning("", "μ of cracks: shear strength is τ + μ N/A; σt is at most τ/μ."),
    },
    members.Member: {
        "kind": Meaning(
            "", "Tie: a bar with axial force. Tendon: a bar of stated tension. Pin: a bolt or dowel across a face."
        ),
        "from_": Meaning("", "One end."),
        "to": Meaning(
            "", "The other end. A pin whose ends coincide is normal to the nearest face between both elements."
        ),
        "through": Meaning("", "Points over which a tie or tendon slides without friction, in order."),
        "tension": Meaning("force", "Largest tension; that of `prestress` where it is not given."),
        "compression": Meaning("force", "Largest compression, 0 for a tie that goes slack; not beside `prestress`."),
        "prestress": Meaning(
            "force", "Tension that always acts, as a dead load on the elements; the force never falls below it."
        ),
        "shear": Meaning("force", "Largest force across a pin, in any direction; pins only."),
        "name": Meaning("", "Name in results; kind and position where it is not given."),
    },
    members.Anchor: {
        "element": Meaning("", "Id of an element, a support or not."),
        "at": Meaning("length", "Point of the element, in the scene."),
    },
    fill.Fill: {
        "level": Meaning("length", "Height of its surface, which is level: the coordinate against gravity."),
        "density": Meaning("mass/length³", "Times gravity, its weight above each point of the structure."),
        "friction_angle": Meaning("degrees", "Angle of internal friction, for active and passive pressure."),
        "cohesion": Meaning("stress", "Lessens the active pressure, adds to the passive one."),
        "surcharge": Meaning("stress", "Permanent vertical pressure on the surface, such as a road."),
        "dispersal": Meaning("degrees", "Angle from the vertical at which loads on the surface spread with depth."),
        "active": Meaning("", "Share of Rankine's active pressure that always acts."),
        "passive": Meaning("", "Share of the weight's part of Rankine's passive pressure that can be reached."),
        "passive_cohesion": Meaning("", "Share of the cohesion's part of the passive pressure that can be reached."),
        "start": Meaning("length", "Horizontal place at which it begins; the end of the structure if absent."),
        "end": Meaning("length", "Horizontal place at which it ends; the end of the structure if absent."),
    },
    fill.FillLoad: {
        "on_fill": Meaning("", "Strip of the surface of the fill that carries the load."),
        "weight": Meaning("force", "The load, along gravity; what falls beside free elements is left out."),
    },
    fill.Strip: {"at": Meaning("length", "Horizontal place of its middle."), "width": Meaning("length", "Its width.")},
    loads.Loads: {
        "dead": Meaning("", "Loads that λ does not multiply, beside self-weight."),
        "live": Meaning("", "Loads that λ multiplies; together they must not be zero. Not beside `cases`."),
        "cases": Meaning("", "Several patterns of load; the one with the least λ over `required` governs."),
        "moving": Meaning("", "Vehicles on a planar structure: a load case for each position. Not beside `live`."),
        "pushes": Meaning("", "Horizontal pushes: a load case for each direction. Not beside `live`."),
    },
    loads.Pushes: {
        "name": Meaning("", "First word of the names of its load cases, which end with the angle of the direction."),
        "of_weight": Meaning("", "Share of its weight that pushes each free element."),
        "directions": Meaning("", "Number of horizontal directions at equal angles (planar 1 or 2), or vectors."),
        "required": Meaning("", "Load factor that is asked of every direction."),
    },
    design.Design: {
        "set": Meaning("", "Set of partial factors: `EN 1990`, `EN 1990 EQU`, `EN 1996-1-1`, or an own name."),
        "units": Meaning("", "Category of masonry units, for γM of EN 1996-1-1, 2.4.3."),
        "mortar": Meaning("", "Kind of mortar of units of category I, for γM of EN 1996-1-1, 2.4.3."),
        "execution": Meaning("", "Class of execution control, for γM of EN 1996-1-1, 2.4.3."),
        "factors": Meaning("", "Factors in the place of those of the set; an own set has them all here."),
    },
    design.DesignFactors: {
        "self_weight": Meaning("", "γG of self-weight, favourable and unfavourable; both are tried."),
        "dead": Meaning("", "γG of `loads.dead`, favourable and unfavourable; both are tried."),
        "prestressing": Meaning("", "γP of the prestress of members, favourable and unfavourable; both are tried."),
        "live": Meaning("", "γQ of all live loads."),
        "strength": Meaning("", "γM: divides strengths and cohesion."),
        "friction": Meaning("", "Divides the friction coefficient, tan φ."),
        "members": Meaning("", "Divides the capacities of members."),
    },
    loads.MovingLoad: {
        "name": Meaning("", "First word of the names of its load cases, which end with the place of the first axle."),
        "axles": Meaning("", "The axles, in the order in which they enter the path."),
        "path": Meaning("length", "Points of a polyline on the outline of the structure."),
        "steps": Meaning("", "Positions, from the first axle at the start of the path to the last one at its end."),
        "both_directions": Meaning("", "Whether it also moves from the end to the start."),
        "required": Meaning("", "Load factor that is asked of every position."),
    },
    loads.Axle: {
        "weight": Meaning("force", "Weight of the axle, along gravity."),
        "distance": Meaning("length", "Distance to the axle before it; of the first one without effect."),
    },
    loads.FaceLoad: {
        "face": Meaning("", "Where the load acts: on free boundary alone, not on interfaces."),
        "pressure": Meaning("stress", "Force per area, inwards; two numbers: at the first and last point of `along`."),
        "line": Meaning("force/length", "Force per length of `along`, a vector; in the place of a pressure."),
        "traction": Meaning("stress", "Force per area of `patch`, a vector; in the place of a pressure."),
    },
    loads.FacePlace: {
        "between": Meaning("", 'Id of a free element and `"outside"`: the whole free boundary of the element.'),
        "along": Meaning("length", "Points of a polyline on the outline of a planar structure."),
        "patch": Meaning("length", "Corners of a plane polygon on the free surface of solids."),
    },
    loads.Case: {
        "name": Meaning("", "What the case is called in tables, a name of its own."),
        "live": Meaning("", "Loads that λ of this case multiplies."),
        "dead": Meaning("", "Loads of this case that λ does not multiply, beside `loads.dead`."),
        "required": Meaning("", "Load factor that is asked of this case."),
    },
    loads.PointLoad: {
        "element": Meaning("", "Id of the free element that carries it."),
        "force": Meaning("force", "The force."),
        "at": Meaning("length", "Where it acts, outside the element too; the centroid where it is not given."),
        "moment": Meaning("force·length", "A moment: a number in the plane (counter-clockwise), a vector in space."),
        "width": Meaning("length", "Patch that the force is spread on by `cracks` as fields; else its free face."),
    },
    loads.BodyLoad: {"body": Meaning("", "On every free element its weight, as a positive number, times this vector.")},
    loads.TiltLoad: {
        "tilt": Meaning("", "A table on which the structure is tilted: weights turn, and λ is the tangent of an angle.")
    },
    loads.Tilt: {
        "towards": Meaning("", "Horizontal direction in which it leans more and more."),
        "pivot": Meaning("length", "A point, in space two points, of the line it turns about; it changes no force."),
    },
    loads.Settling: {
        "name": Meaning("", "What it is called."),
        "supports": Meaning("", "Which supports move, and how; supports that are not named stay."),
        "load": Meaning("", "Share of the live load that acts meanwhile."),
    },
    loads.Moved: {
        "elements": Meaning("", "Ids of supports that move as one."),
        "move": Meaning("", "Translation, for a unit of the movement."),
        "turn": Meaning("", "Rotation, for a unit of the movement: counter-clockwise, in space a vector."),
        "about": Meaning("length", "Point that they turn about; the middle of their centroids where it is not given."),
    },
    search.Labels: {
        "default": Meaning("", "Label of all faces that nothing else labels, those to supports too."),
        "inner": Meaning("", "Pairs of ids whose faces are inner."),
        "dry": Meaning("", "Pairs of ids whose faces are dry."),
    },
    search.Search: {
        "candidates": Meaning(
            "",
            "Faces that may take either label: all between two free elements, those to supports too, those inside the "
            "scene's own blocks, or the faces of pairs of ids. Other faces keep their label.",
        ),
        "keep": Meaning("", "Pairs whose label is fixed."),
        "segmentation": Meaning(
            "", "No slits: every dry face separates two blocks; supports that touch are one block."
        ),
        "block_cells": Meaning("", "Least and most free elements in a block."),
        "block_weight": Meaning("force", "Least and most weight of a block."),
        "block_extent": Meaning("length", "Least and most extent of a block along any axis."),
        "block_mass": Meaning("mass", "Least and most mass of a block: its weight over gravity, kg with m and N."),
        "block_aspect": Meaning("", "Longest over shortest side of the smallest box around a block."),
        "except_": Meaning("", "Ids of free elements: blocks that hold one are under no limit on single blocks."),
        "convex_blocks": Meaning("", "Convex blocks only; in the plane a number: at most so many re-entrant corners."),
        "blocks": Meaning("", "Least and most blocks that hold a free element."),
        "dry_faces": Meaning("", "Least and most dry faces between free elements."),
        "shapes": Meaning("", "Least and most different shapes of blocks."),
        "sawn_length": Meaning(
            "", "Least and most length (m), in space area (m²), of the faces of all blocks, those at supports included."
        ),
        "saw_cuts": Meaning(
            "", "Least and most sawn faces of all blocks; the two sides of planar blocks are left out."
        ),
        "saw_set_ups": Meaning("", "Least and most set-ups of the saw: directions of faces, summed over the shapes."),
        "limits": Meaning("", "Bounds of further counts by name: any count of the tables, those of plug-ins too."),
        "moulds": Meaning("", "What counts as one shape beside being moved."),
        "require": Meaning(
            "", "A load factor to be met; the best by the front's count is looked for among what meets it."
        ),
        "void": Meaning("", "Cells that may be left out; without it all stay."),
        "assemble": Meaning(
            "",
            "Only layouts that can be laid: `translation`, in some order by translations, at most three blocks moved "
            "together; `standing`, in an order found whose every stage stands without props.",
        ),
        "assemble_out_of_plane": Meaning("", "Planar walls may be laid from the side (`assemble`, `jld assembly`)."),
        "symmetry": Meaning(
            "",
            "Layouts that are equal under the scene's own symmetries are one class (`auto`); `mirror-x` is an error on "
            "a scene that is not symmetric.",
        ),
        "front": Meaning("", "The second objective beside λ, which is always maximised."),
    },
    search.Keep: {
        "dry": Meaning("", "Pairs of ids whose faces stay dry."),
        "inner": Meaning("", "Pairs of ids whose faces stay inner."),
    },
    search.Require: {"load_factor": Meaning("", "λ that layouts must reach, with load cases the governing factor.")},
    search.Moulds: {
        "rotate": Meaning("", "Blocks that a turn lays onto one another are one shape."),
        "flip": Meaning("", "Blocks that turning over lays onto one another are one shape."),
    },
    search.VoidCells: {
        "cells": Meaning("", "Ids of free elements that no load names, or all of these."),
        "most": Meaning("", "Share of the volume of all free elements that may be left out."),
    },
    search.Front: {
        "count": Meaning("", "A count: `dry_faces`, `dry_length` (in space an area), `blocks`, or a registered one."),
        "counts": Meaning("", "Two counts instead of one: a front of three objectives."),
        "sense": Meaning("", "Whether more of it or less is better; of two counts a list, or one word for both."),
    },
    cracks.CellCracks: {
        "kind": Meaning("", "The crack model."),
        "cell": Meaning("length", "Size of the cells; of a grid, its width and height are multiples of it."),
    },
    cracks.FieldCracks: {
        "kind": Meaning("", "The crack model."),
        "gap": Meaning("", "Relative width of the bracket at which refinement ends."),
    },
    move.Move: {
        "vertices": Meaning("", "All vertices of dry joints, or only those that `along` names."),
        "along": Meaning("", "Lines and circles on which vertices slide."),
        "ties": Meaning(
            "",
            "Vertices that move alike: mirrored about the middle, or the same way within each list; `equal-shapes`: "
            "elements of equal shape stay equal.",
        ),
        "inner": Meaning(
            "",
            "Vertices of inner faces: `stay`; or `follow`, free where joints end in them, else with their neighbours.",
        ),
        "straight": Meaning("", "Whether straight faces of blocks stay straight where joints end in them."),
        "angle": Meaning("degrees", "Bounds of the angles at corners of elements."),
        "edge": Meaning("length", "Least edge of an element; 0.15 of the mean edge where it is not given."),
        "block_mass": Meaning("mass", "Bounds of the mass of each block."),
        "draft": Meaning("", "Least inclination of joints to the direction in which blocks are lifted out."),
        "box": Meaning("length", "Largest distance that a vertex moves along each of its directions."),
        "maximise": Meaning("", "λ; or the least friction, or thickness of an arch, at which the dead load stands."),
    },
    move.Path: {
        "at": Meaning("length", "A vertex that slides along `direction`; two entries let it move freely."),
        "direction": Meaning("", "Its direction."),
        "circle": Meaning("length", "Centre of circles on which the joints of an arch end."),
        "supports": Meaning("", "Joints with supports turn on the circle as well, and the supports with them."),
    },
    move.Draft: {
        "direction": Meaning("", "Direction in which blocks are lifted out."),
        "degrees": Meaning("degrees", "Least angle between it and each dry joint that moves."),
    },
}
"""By part of the scene and by key, in the order of the schema."""
