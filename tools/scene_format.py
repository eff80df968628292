"""Write what is generated: docs/scene_keys.md and docs/scene.schema.json from the schema, docs/settings.md."""

from __future__ import annotations

import json
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Final

from jld_core import Model
from jld_explore import ExploreSettings
from jld_explore.cli.explore import explore_command
from jld_explore.cli.options import flags_of
from jld_explore.cli.solve import solve
from tools.scene_form import json_schema, key_tables

DOCS: Final = Path(__file__).resolve().parent.parent / "docs"
HEAD: Final = """# Scene files: every key

Generated from the schema by `python -m tools.scene_format`. A walk through the usual parts is in the
[guide](guide/scenes.md), what a program may rely on in the [contract](scene.md). Units are the scene's own, whatever it
says consistently: length (m), force (N), stress (Pa = N/m²), mass (kg); numbers of other units must agree with them.

Editors complete and check scenes by the JSON schema in `docs/scene.schema.json`: name its path in the key `"$schema"`
of the file, which the program does not read, or in the settings of the editor. It knows keys, types and bounds; what
depends on several keys at once (one form of geometry, ids that exist) is checked by `jld check`.

Where a number may be an object, that is `{"mean": m, "cov": v, "kind": "normal" | "lognormal"}`, a value with
uncertainty ([reliability](guide/reliability.md)); a material value may also be `{"nominal": n, "low": l}`.

"""


SETTINGS: Final = """# Settings: model and search

Generated from the fields of `Model` and `ExploreSettings` by `python -m tools.scene_format`. Python takes them as
keywords, as in `solve(scene, model=Model(gap=1e-4))` and `explore(scene, driver="exact")`; the command named takes the
flag.
"""


def settings_tables() -> str:
    """A table of the model's settings and one of a search's: name, flag, type, default and meaning."""
    text = SETTINGS
    for kind, command, called in ((Model, solve, "jld solve"), (ExploreSettings, explore_command, "jld explore")):
        flags = flags_of(command)
        text += f"\n## `{kind.__name__}`\n\n| keyword | flag of `{called}` | type | default | meaning |\n"
        text += "|---|---|---|---|---|\n"
        for one in fields(kind):
            flag = f"`{flags[one.name]}`" if one.name in flags else ""
            default = repr({} if one.default is MISSING else one.default) if one.name != "model" else "Model()"
            row = (f"`{one.name}`", flag, f"`{one.type}`", f"`{default}`", one.metadata["words"])
            text += "| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |\n"
    return text


def files() -> dict[Path, str]:
    """Texts by the file they belong in."""
    return {
        DOCS / "scene_keys.md": HEAD + key_tables(),
        DOCS / "settings.md": settings_tables(),
        DOCS / "scene.schema.json": json.dumps(json_schema(), indent=1, ensure_ascii=False) + "\n",
    }


def main() -> None:
    """Write all."""
    for path, text in files().items():
        path.write_text(text, encoding="utf-8")
        print(path)


if __name__ == "__main__":
    main()
