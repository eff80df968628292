"""Write what is generated from the scene schema: docs/scene_keys.md and docs/scene.schema.json."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

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


def files() -> dict[Path, str]:
    """Texts by the file they belong in."""
    return {
        DOCS / "scene_keys.md": HEAD + key_tables(),
        DOCS / "scene.schema.json": json.dumps(json_schema(), indent=1, ensure_ascii=False) + "\n",
    }


def main() -> None:
    """Write both."""
    for path, text in files().items():
        path.write_text(text, encoding="utf-8")
        print(path)


if __name__ == "__main__":
    main()
