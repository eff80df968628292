"""Add the options of all drivers to a command."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Annotated, Any, get_type_hints

import typer

from jld_explore.drivers import driver_kinds
from jld_explore.drivers.registry import owners


def with_driver_options(command: Callable[..., None]) -> Callable[..., None]:
    """Decorate a command so that it also has the options of all search drivers."""
    # The command gets their values, texts or None, as further keyword arguments. The help texts come from the drivers,
    # which also validate the values.
    kinds = {name: list(owners(name)) for kind in driver_kinds().values() for name in kind.Options.model_fields}
    types = {name: hint for name, hint in get_type_hints(command, include_extras=True).items() if name != "own"}
    stated = inspect.signature(command).parameters
    parameters = [p.replace(annotation=types[name]) for name, p in stated.items() if name in types]
    for name, drivers in kinds.items():
        field = drivers[0].Options.model_fields[name]
        spoken = " and ".join(sorted(kind.name for kind in drivers))
        words = f"{spoken.capitalize()} driver{'s' * (len(drivers) > 1)}: {field.description}."
        types[name] = Annotated[str | None, typer.Option(help=words)]
        parameters.append(inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=types[name]))

    def run(**given: Any) -> None:
        command(**given)

    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__, run.__doc__ = types, command.__doc__
    return run
