"""Writer of IFC 4 files: a faceted B-rep and a property set for each block.

Uses ifcopenshell.
"""

from __future__ import annotations

import uuid
from pathlib import Path
from typing import Any, Final

import numpy as np

from jld_core import Layout, files
from jld_core.geometry import unions
from jld_core.scene import units as scene_units
from jld_formats.facts import BlockFacts, block_facts
from jld_formats.libraries import library
from jld_formats.read_ifc import DENSITY
from jld_formats.read_ifc import PROPERTIES as MATERIAL_PROPERTIES
from jld_formats.read_mesh import solids_of

# Namespace of the name-based identifiers of written objects
_SPACE: Final = uuid.UUID("7046bc60-2e03-5556-92a4-4d5840e259ee")

# Prefixes of the metre; lengths in other units are written in metres
_PREFIX: Final = {"m": None, "mm": "MILLI", "cm": "CENTI", "dm": "DECI", "km": "KILO"}

PROPERTIES: Final = "Jld_Block"
"""Name of the property set of a block."""


def write_ifc(layout: Layout, path: Path, *, cells: bool) -> None:
    """Write an IFC 4 file with a building element proxy for each block."""
    # Each proxy has the properties mass, mould, order, λ and faces.
    ifc = library("ifcopenshell", path)
    file = _Ifc(ifc, layout)
    facts = block_facts(layout)
    owner = [int(k) for k in layout.block_of] if cells else [
        k for k, surfaces in enumerate(layout.surfaces) for _ in surfaces
    ]  # fmt: skip
    elements = [
        file.element(name, support, surface, facts[owner[number]])
        for number, (name, support, surface) in enumerate(solids_of(layout, cells=cells))
    ]
    file.contain(elements)
    own = layout.assembly.elements if cells else None
    masses = own.mass.tolist() if own is not None else [facts[k].mass for k in owner]
    volumes = own.volume.tolist() if own is not None else [facts[k].volume for k in owner]
    file.materials(elements, masses, volumes)
    path.write_text(file.model.to_string(), encoding="ascii")  # errors of its own writer name no reason


class _Ifc:
    """IFC model under construction."""

    def __init__(self, ifc: Any, layout: Layout) -> None:
        from importlib import import_module

        self._compress = import_module("ifcopenshell.guid").compress
        self._name = layout.assembly.name
        self.model = ifc.file(schema="IFC4")
        header = self.model.header
        header.file_name.name = files.printable(self._name)
        header.file_name.time_stamp = "1970-01-01T00:00:00"  # the same layout gives the same file
        make = self.model.create_entity
        unit = layout.assembly.units[0]
        self._scale = 1.0 if unit in _PREFIX else scene_units.METRES.get(unit, 1.0)
        # masses are weights over gravity in m/s²: kg where forces are in N
        self._kilograms = scene_units.NEWTONS.get(layout.assembly.units[1], 1.0)
        self._cubic_metres = scene_units.METRES.get(unit, 1.0) ** 3
        mass = make("IfcSIUnit", UnitType="MASSUNIT", Prefix="KILO", Name="GRAM")
        metre = make("IfcSIUnit", UnitType="LENGTHUNIT", Name="METRE")
        powers = [make("IfcDerivedUnitElement", mass, 1), make("IfcDerivedUnitElement", metre, -3)]
        units = [
            make("IfcSIUnit", UnitType="LENGTHUNIT", Prefix=_PREFIX.get(unit), Name="METRE"),
            make("IfcSIUnit", UnitType="AREAUNIT", Name="SQUARE_METRE"),
            make("IfcSIUnit", UnitType="VOLUMEUNIT", Name="CUBIC_METRE"),
            mass,
            make("IfcDerivedUnit", Elements=powers, UnitType="MASSDENSITYUNIT"),
            make("IfcSIUnit", UnitType="PLANEANGLEUNIT", Name="RADIAN"),
        ]
        self._world = make("IfcAxis2Placement3D", Location=make("IfcCartesianPoint", Coordinates=(0.0, 0.0, 0.0)))
        context = make(
            "IfcGeometricRepresentationContext",
            ContextType="Model",
            CoordinateSpaceDimension=3,
            Precision=1e-9,
            WorldCoordinateSystem=self._world,
        )
        self._body = make(
            "IfcGeometricRepresentationSubContext",
            ContextIdentifier="Body",
            ContextType="Model",
            ParentContext=context,
            TargetView="MODEL_VIEW",
        )
        self._project = make(
            "IfcProject",
            GlobalId=self._id("project"),
            Name=files.printable(self._name),
            RepresentationContexts=[context],
            UnitsInContext=make("IfcUnitAssignment", Units=units),
        )
        self._building = make(
            "IfcBuilding",
            GlobalId=self._id("building"),
            Name=files.printable(self._name),
            ObjectPlacement=self._placement(None),
            CompositionType="ELEMENT",
        )
        make(
            "IfcRelAggregates",
            GlobalId=self._id("aggregates"),
            RelatingObject=self._project,
            RelatedObjects=[self._building],
        )

    def _id(self, words: str) -> str:
        """Return the global identifier of an object, derived from its name."""
        return str(self._compress(uuid.uuid5(_SPACE, f"{self._name} {words}").hex))

    def _placement(self, relative: Any) -> Any:
        return self.model.create_entity("IfcLocalPlacement", PlacementRelTo=relative, RelativePlacement=self._world)

    def element(self, name: str, support: bool, surface: unions.Surface, facts: BlockFacts) -> Any:
        """Add the element of a block with its property set, and return it."""
        make = self.model.create_entity
        shape = make(
            "IfcShapeRepresentation",
            ContextOfItems=self._body,
            RepresentationIdentifier="Body",
            RepresentationType="Brep",
            Items=[self._brep(surface)],
        )
        element = make(
            "IfcBuildingElementProxy",
            GlobalId=self._id(f"element {name}"),
            Name=files.printable(name),
            ObjectType="SUPPORT" if support else f"SHAPE_{facts.shape:02d}",
            ObjectPlacement=self._placement(self._building.ObjectPlacement),
            Representation=make("IfcProductDefinitionShape", Representations=[shape]),
            PredefinedType="USERDEFINED",
        )
        properties = [
            make("IfcPropertySingleValue", Name=key, NominalValue=make(kind, value))
            for key, kind, value in _values(facts, self._kilograms)
        ]
        found = make(
            "IfcPropertySet", GlobalId=self._id(f"properties {name}"), Name=PROPERTIES, HasProperties=properties
        )
        make(
            "IfcRelDefinesByProperties",
            GlobalId=self._id(f"defines {name}"),
            RelatedObjects=[element],
            RelatingPropertyDefinition=found,
        )
        return element

    def _brep(self, surface: unions.Surface) -> Any:
        """Return a faceted B-rep of a closed surface."""
        make = self.model.create_entity
        places = (self._scale * np.asarray(surface.points)).tolist()
        points = [make("IfcCartesianPoint", Coordinates=tuple(place)) for place in places]
        faces = []
        for loop in surface.faces:
            ring = make("IfcPolyLoop", Polygon=[points[index] for index in loop])
            faces.append(make("IfcFace", Bounds=[make("IfcFaceOuterBound", Bound=ring, Orientation=True)]))
        return make("IfcFacetedBrep", Outer=make("IfcClosedShell", CfsFaces=faces))

    def contain(self, elements: list[Any]) -> None:
        """Place all elements in the building."""
        self.model.create_entity(
            "IfcRelContainedInSpatialStructure",
            GlobalId=self._id("contained"),
            RelatedElements=elements,
            RelatingStructure=self._building,
        )

    def materials(self, elements: list[Any], masses: list[float], volumes: list[float]) -> None:
        """Add a material of each mass density, kg/m³, and relate the elements to theirs."""
        make = self.model.create_entity
        by_density: dict[float, list[Any]] = {}
        for element, mass, volume in zip(elements, masses, volumes, strict=True):
            if mass > 0.0 and volume > 0.0:
                density = float(f"{mass * self._kilograms / (volume * self._cubic_metres):.12g}")
                by_density.setdefault(density, []).append(element)
        for density, own in by_density.items():
            material = make("IfcMaterial", Name=f"{density:.12g} kg/m3")
            stated = make("IfcPropertySingleValue", Name=DENSITY, NominalValue=make("IfcMassDensityMeasure", density))
            make("IfcMaterialProperties", Name=MATERIAL_PROPERTIES, Properties=[stated], Material=material)
            make(
                "IfcRelAssociatesMaterial",
                GlobalId=self._id(f"material {density:.12g}"),
                RelatedObjects=own,
                RelatingMaterial=material,
            )


def _values(facts: BlockFacts, kilograms: float) -> list[tuple[str, str, Any]]:
    """Return name, IFC type and value of each property of a block that is known."""
    found: list[tuple[str, str, Any]] = [
        ("Block", "IfcLabel", files.printable(facts.block)),
        ("Elements", "IfcText", files.printable(" ".join(facts.elements))),
        ("Support", "IfcBoolean", facts.support),
        ("Mass", "IfcMassMeasure", kilograms * facts.mass),
        ("DryFacesTo", "IfcText", files.printable(" ".join(facts.dry))),
        ("InnerFaces", "IfcInteger", facts.inner),
    ]
    if facts.shape:
        found.append(("Mould", "IfcInteger", facts.shape))
    if facts.order is not None:
        found.append(("Order", "IfcInteger", facts.order))
    if facts.load_factor is not None:
        found.append(("LoadFactor", "IfcReal", facts.load_factor))
    return found
