"""Mass densities of the materials of an IFC file, kg/m³."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from typing import Any, Final

import numpy as np

from jld_core.errors import InputError

PROPERTIES: Final = "Pset_MaterialCommon"
"""Name of the standard property set of a material that holds its density."""

DENSITY: Final = "MassDensity"
"""Name of the density in that set."""

_GRAM: Final = 1e-3  # kilograms in the mass unit of IFC, the gram


class Densities:
    """Densities of products by their materials.

    model: IFC model of schema IFC2X3, IFC4 or IFC4X3.
    """

    def __init__(self, model: Any) -> None:
        self._materials_of = import_module("ifcopenshell.util.element").get_materials
        units = [unit for one in model.by_type("IfcUnitAssignment") for unit in one.Units]
        density = [unit for unit in units if getattr(unit, "UnitType", None) == "MASSDENSITYUNIT"]
        self._scale = _scale(density[0]) if density else 1.0
        self._older: dict[int, float] = {}
        if model.schema == "IFC2X3":
            for one in model.by_type("IfcGeneralMaterialProperties"):
                if one.MassDensity is not None:
                    self._older[one.Material.id()] = self._scale * float(one.MassDensity)

    def of(self, product: Any, title: str) -> float | None:
        """Return the density of a product, kg/m³; None where its materials state none, or several.

        title: words for the product. Raises InputError for a density that is no positive number.
        """
        found = {value for material in self._materials_of(product) for value in self._stated(material)}
        for value in found:
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(title, f"the mass density of its material is {value:g}", "a positive number")
        return found.pop() if len(found) == 1 else None

    def _stated(self, material: Any) -> Iterator[float]:
        """Yield the densities that a material states."""
        if material.id() in self._older:
            yield self._older[material.id()]
        for properties in getattr(material, "HasProperties", None) or ():
            for one in getattr(properties, "Properties", None) or ():
                value = getattr(one, "NominalValue", None)
                if one.Name == DENSITY and value is not None:
                    yield (_scale(one.Unit) if one.Unit is not None else self._scale) * float(value.wrappedValue)


def _scale(unit: Any) -> float:
    """Return a unit of IFC in m, kg and s."""
    if unit.is_a("IfcDerivedUnit"):
        return float(np.prod([_scale(part.Unit) ** part.Exponent for part in unit.Elements]))
    if unit.is_a("IfcConversionBasedUnit"):
        factor = unit.ConversionFactor
        return float(factor.ValueComponent.wrappedValue) * _scale(factor.UnitComponent)
    prefix = getattr(unit, "Prefix", None)
    size = float(import_module("ifcopenshell.util.unit").get_prefix_multiplier(prefix)) if prefix else 1.0
    return size * (_GRAM if unit.Name == "GRAM" else 1.0)
