"""Refuse settings of a search that exclude each other or do not fit the structure."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from jld_core.assembly import Assembly
from jld_core.errors import InputError, ParameterError
from jld_core.models import require_cracks, require_model
from jld_core.scene import Scene
from jld_core.scene.cracks import FieldCracks
from jld_core.strengths import Route
from jld_explore.drivers import Driver
from jld_explore.drivers.exact.certifying import check_certifiable
from jld_explore.drivers.exact.driver import Exact
from jld_explore.drivers.field_exact import FieldExact
from jld_explore.search.settings import ExploreSettings

# Why a driver with conflicts of single faces refuses other crack models
_SHARED: Final = (
    "proves by mechanisms at faces with a label each, and by cells or fields one label holds for many cracks"
)
_ROUTE: Final = Route("the virtual experiment")


def refuse_together(scene: Scene, settings: ExploreSettings, assembly: Assembly) -> None:
    """Raise InputError for settings that exclude each other or do not support the loads."""
    # With `strict` it is also raised for the first warning of the assembly.
    if assembly.warnings and settings.strict:
        raise InputError("", assembly.warnings[0], "a scene without warnings, or `strict=False`")
    refuse_beside_cracks(scene, settings, assembly)
    if settings.certificate is not None and settings.robust:
        raise ParameterError("certificate", "it proves λ at one value of each strength", "a search with `robust=False`")
    if settings.model.ranks_by_lower_bound and assembly.dimension == 3:
        raise ParameterError("objective", "spatial scenes have no bound without dilation", "zero-dilation")
    if settings.certificate is not None and settings.by_experiment:
        raise ParameterError("certificate", "an experiment is no proof", '`objective="associative"`')
    if settings.by_experiment or settings.experiment is not None:
        assembly.strengths(_ROUTE)  # refuses what experiments would refuse after the search has begun
    refuse_beside_own_objective(scene, settings)


def refuse_beside_own_objective(scene: Scene, settings: ExploreSettings) -> None:
    """Raise InputError for settings that exclude an objective of the user; nothing is refused without one."""
    # Such settings need bounds on λ, or rank by something else.
    if settings.own_objective is None:
        return
    driver = settings.driver
    proves = driver.modular if isinstance(driver, Driver) else driver == Exact.name
    for name, asked in (
        ("`driver`", proves),
        ("`certificate`", settings.certificate is not None),
        ("`robust`", settings.robust),
        ("`experiment`", settings.experiment is not None),
        ("search.void", scene.search.void is not None),
        ("search.require", scene.search.require is not None),
    ):
        if asked:
            raise ParameterError("objective", f"{name} needs λ, and the objective is a function", "one of both")


def refuse_beside_cracks(scene: Scene, settings: ExploreSettings, assembly: Assembly) -> None:
    """Raise InputError for settings that cracks by cells or by fields exclude."""
    # Scenes that crack along faces alone pass.
    if scene.cracks == "faces":
        return
    fields = isinstance(scene.cracks, FieldCracks)
    for option, asked in (
        ("certificate", settings.certificate is not None),
        ("experiment", settings.experiment is not None or settings.by_experiment),
        ("objective", settings.own_objective is not None and fields),
        ("search.void", scene.search.void is not None),
        ("search.assemble", scene.search.assemble == "standing"),
    ):
        if asked:
            raise ParameterError(
                option, "it supports cracks by faces only", 'a search without it, or "cracks": "faces"'
            )
    if isinstance(settings.driver, str) and settings.driver == Exact.name and not fields:
        raise ParameterError("driver", f"{Exact.name} {_SHARED}", 'another driver, or "cracks": "faces"')
    if fields and assembly.dimension == 3:
        raise ParameterError(
            "cracks", "one layout in space takes minutes by fields", "a search by faces, then solve by fields"
        )
    require_cracks(assembly, settings.model)


def refuse_unfit(scene: Scene, assembly: Assembly, settings: ExploreSettings, driver: Driver) -> None:
    """Raise InputError if driver, model, experiment or certificate do not fit the structure."""
    # If a certificate is requested, also restrict the exact driver to proofs that a certificate can hold.
    if driver.modular and scene.cracks != "faces":
        raise ParameterError("driver", f"{driver.name} {_SHARED}", "another driver")
    if isinstance(driver, FieldExact) and not isinstance(scene.cracks, FieldCracks):
        raise ParameterError("driver", "FieldExact proves by fields, and the scene cracks otherwise", "`Exact`")
    if driver.modular and not replace(settings.model, friction="associative").supports_bounds_over_labellings:
        raise ParameterError(
            "driver", f"{driver.name} has no bounds for this model", "convex contact on whole faces, uncoupled bending"
        )
    space = driver.space
    dry = (space.candidates | space.fixed) & (space.assembly.interfaces.b != space.assembly.sink)
    require_model(space.assembly, settings.model, dry)
    if settings.certificate is not None:
        check_certifiable(driver, settings.model, scene)
        if isinstance(driver, Exact):
            driver.disable_block_bounds()


def refuse_beside_void(settings: ExploreSettings, driver: Driver) -> None:
    """Raise InputError for options that need a single structure if cells may be left out."""
    for option, asked in (
        ("experiment", settings.experiment is not None or settings.by_experiment),
        ("driver", driver.modular),
    ):
        if asked:
            raise ParameterError(option, "it needs one structure, and search.void leaves cells out", "a search without")
