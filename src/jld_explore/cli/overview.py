"""Provide the text of `jld --help` without slow imports, so that it appears at once."""

from __future__ import annotations

from typing import Final

from jld_core import plugins

_GROUPS: Final = {
    "Make a scene": {
        "new": "write a scene by name: arch, wall, corner, vault, dome, flat-arch, buttress, grid",
        "import": "make a scene of a drawing or of solids",
        "refine": "split the elements of a scene into smaller candidate cells",
        "check": "what will be modelled, and what looks wrong",
    },
    "Find the best layout": {
        "design": "the blocks of an outline: cells tried, joints searched and moved, the best checked",
        "explore": "search the layouts of a scene for the strongest: table, front, pictures, page",
        "cut": "cut a solid to the fewest parts that fit a machine, go together and carry a load",
        "move": "move the joints of a layout for the largest load factor, or prove the best in a box",
        "verify": "check the certificate of a proof",
    },
    "Ask one layout": {
        "solve": "collapse load factor of one layout, with a two-sided bracket",
        "thrust": "least and greatest reaction of supports, and forces across joints",
        "settlement": "the thrust that is left where supports give way",
        "check-design": "partial factors: utilisation, reactions, joints near their limit, and a page to file",
        "reliability": "reliability index of a layout whose strengths and loads have distributions",
        "experiment": "load a layout in a virtual experiment until it comes down",
        "map": "λ and mechanisms over values of a scene, or the strongest layout at each",
        "benchmark": "problems with proven answers, and the check of layouts that others found",
    },
    "Show and build it": {
        "studio": "move joints by hand and see the proven load follow, in a browser",
        "plot": "draw a scene, or a search again",
        "assembly": "an order in which the blocks can be laid",
        "report": "printed pages of a layout: loads, numbered stones, moulds, laying, what is proven",
        "export": "write the blocks of a layout for another program",
    },
}

# description of each command, in the order of use
COMMANDS: Final = {name: words for group in _GROUPS.values() for name, words in group.items()}

# description of each search driver
DRIVERS: Final = {
    "enumeration": "every layout once; the best is proven. Default where the space is small",
    "exact": "proves the best of spaces far too large to enumerate. Default where that is in reach",
    "portfolio": "good layouts of large scenes, and fronts. Default elsewhere",
    "genetic": "good layouts of large scenes, and fronts of several counts",
    "random": "a baseline",
    "hillclimb": "a baseline",
    "anneal": "the strongest layout of a large scene, without proof",
    "optuna": "any of its samplers",
}

_HEAD = """Usage: jld [OPTIONS] COMMAND [ARGS]...

  Joint Layout Design: find the strongest way to cut a structure into
  dry-jointed blocks, with proof.
"""
_OPTIONS = {"--version": "Print the version and stop.", "--help": "Show this message, or that of a COMMAND, and stop."}
_EXAMPLE = """  jld new wall --length 1.2 --courses 6 -o wall.json
  jld check wall.json
  jld explore wall.json --out out/wall --seconds 60
  jld export out/wall --format dxf -o wall.dxf"""


def _additions(group: str) -> dict[str, str]:
    """Return what installed plug-ins add to a group, with the package of each."""
    packages = {
        name: plugins.package(point) for name, point in plugins.entry_points(group).items() if name not in COMMANDS
    }
    return {name: f"of the package {package}" for name, package in packages.items()}


def text() -> str:
    """Return the text of `jld --help`: commands, drivers and an example."""
    parts = [_HEAD]
    tables = {
        "Options": _OPTIONS,
        **_GROUPS,
        "Commands of plug-ins": _additions("jld.commands"),
        "Drivers of jld explore (--driver)": DRIVERS | _additions("jld.drivers"),
        "Objectives of plug-ins (--objective)": _additions("jld.objectives"),
        "Counts of plug-ins (search.front, search.limits)": _additions("jld.counts"),
        "Criteria of plug-ins (materials.inner.criterion, materials.dry.criterion)": _additions("jld.criteria"),
        "Steps of plug-ins (after jld explore)": _additions("jld.steps"),
    }
    width = max(map(len, COMMANDS))
    for title, lines in tables.items():
        if not lines:
            continue
        parts.append("\n".join([f"{title}:", *(f"  {name:<{width}}  {words}" for name, words in lines.items())]) + "\n")
    return "\n".join([*parts, "Example:", _EXAMPLE, ""])
