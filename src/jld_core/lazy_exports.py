"""Packages whose exported names are loaded on first use: all of jld takes twice as long as a small `jld solve`."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from types import ModuleType
from typing import Any


class _LazyPackage(ModuleType):
    """Package that imports the module of an exported name when the name is first used."""

    _module_of: dict[str, str]

    def __getattr__(self, name: str) -> Any:
        module = self.__dict__["_module_of"].get(name)
        if module is None:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        if not module:
            return import_module(f"{self.__name__}.{name}")
        value = getattr(import_module(f"{self.__name__}.{module}"), name)
        super().__setattr__(name, value)
        return value

    def __setattr__(self, name: str, value: object) -> None:
        """Set an attribute, except where a loaded module has the name of an exported object."""
        # `jld_explore.explore` must remain the function although a module of this name is loaded.
        if not (self._module_of.get(name) and isinstance(value, ModuleType)):
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self._module_of})


def export_lazily(package: str, modules: Mapping[str, Sequence[str]], submodules: Sequence[str] = ()) -> None:
    """Let a package load its exported names on first use.

    Parameters
    ----------
    package : str
        Name of the package.
    modules : Mapping of str to Sequence of str
        Exported names of each module, named without the package.
    submodules : Sequence of str
        Modules exported as such.
    """
    module_of = {name: module for module, names in modules.items() for name in names}
    package_module = sys.modules[package]
    package_module.__dict__["_module_of"] = module_of | dict.fromkeys(submodules, "")
    package_module.__class__ = _LazyPackage
