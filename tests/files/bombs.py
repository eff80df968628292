"""Small files that expand, nest or branch without end, or nearly so, and the words of the line that they end in."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

SVG = '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" {}>{}</svg>'

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]


def _text(content: Callable[[], str]) -> Callable[[Path], None]:
    return lambda path: path.write_text(content(), encoding="utf-8") and None


def _uses(levels: int, copies: int, tag: str = "g") -> str:
    groups = ['<rect id="l0" width="1" height="1"/>']
    groups += [
        f'<{tag} id="l{k}">' + f'<use xlink:href="#l{k - 1}"/>' * copies + f"</{tag}>" for k in range(1, levels + 1)
    ]
    return SVG.format("", "".join(groups) + f'<use xlink:href="#l{levels}"/>')


def _svg() -> dict[str, tuple[Callable[[Path], None], str]]:
    entities = "".join(f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, 10))
    laughs = f'<!DOCTYPE svg [<!ENTITY a0 "ha">{entities}]>' + SVG.format("", "<text>&a9;</text>")
    depth = 40_000
    return {
        "uses.svg": (_text(lambda: _uses(9, 10)), "by <use>"),
        "uses_two.svg": (_text(lambda: _uses(40, 2)), "by <use>"),
        "symbols.svg": (_text(lambda: _uses(12, 9, "symbol")), "by <use>"),
        "use_of_itself.svg": (
            _text(lambda: SVG.format("", '<g id="a"><use href="#b"/></g><g id="b"><use href="#a"/></g>')),
            "contains itself",
        ),
        "laughs.svg": (_text(lambda: laughs), "XML entities"),
        "deep_groups.svg": (_text(lambda: SVG.format("", "<g>" * depth + "</g>" * depth)), "too deeply"),
        "chain_of_uses.svg": (
            _text(
                lambda: SVG.format(
                    "",
                    '<rect id="u0" width="1" height="1"/>'
                    + "".join(f'<use id="u{k}" href="#u{k - 1}"/>' for k in range(1, 5000)),
                )
            ),
            "by <use>",
        ),
        "long_path.svg": (
            _text(lambda: SVG.format("", '<path d="M0 0' + "".join(f" L{k} {k % 7}" for k in range(210_000)) + '"/>')),
            "too many",
        ),
        "round_path.svg": (
            _text(lambda: SVG.format("", '<path d="M0 0' + " a1 2 0 0 1 1 0" * 8_000 + '"/>')),
            "too many",
        ),
        "many_shapes.svg": (_text(lambda: SVG.format("", '<rect width="1" height="1"/>' * 300_000)), "05 shapes; "),
    }


def _blocks(levels: int, copies: int) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        import ezdxf

        document = ezdxf.new()
        document.blocks.new("B0").add_lwpolyline(SQUARE, close=True)
        for level in range(1, levels + 1):
            block = document.blocks.new(f"B{level}")
            for k in range(copies):
                block.add_blockref(f"B{level - 1}", (k, 0))
        document.modelspace().add_blockref(f"B{levels}", (0, 0))
        document.saveas(path)

    return write


def _drawn(draw: Callable[[Any], Any]) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        import ezdxf

        document = ezdxf.new(units=6)
        document.blocks.new("B").add_lwpolyline(SQUARE, close=True)
        draw(document.modelspace())
        document.saveas(path)

    return write


def _fan(space: Any) -> None:
    for k in range(3000):
        space.add_line((k, 0), (3000 - k, 1000))


def _hatch_of_lines(space: Any) -> None:
    hatch = space.add_hatch()
    edges = hatch.paths.add_edge_path()
    count = 1500
    for k in range(count):
        j = k * 2579 % count  # in no order
        edges.add_line((j, (j % 2) * 0.5), ((j + 1) % count, ((j + 1) % 2) * 0.5))


def _hatch_of_squares(space: Any) -> None:
    hatch = space.add_hatch()
    for k in range(3000):
        hatch.paths.add_polyline_path([(x + 2 * (k % 80), y + 2 * (k // 80)) for x, y in SQUARE], is_closed=True)


def _circles(space: Any) -> None:
    for k in range(6000):
        space.add_arc((0, 0), 1.0, k / 20, k / 20 + 1)


def _spline(space: Any) -> None:
    space.add_open_spline([(k, (k % 2) * 1000) for k in range(1500)], degree=3)


def _dxf() -> dict[str, tuple[Callable[[Path], None], str]]:
    return {
        "blocks.dxf": (_blocks(10, 10), "too many entities"),
        "blocks_two.dxf": (_blocks(15, 2), "too many entities"),
        "deep_blocks.dxf": (_blocks(500, 1), "too deeply"),
        "rows.dxf": (
            _drawn(lambda s: s.add_blockref("B", (0, 0), {"row_count": 30_000, "column_count": 30_000})),
            "too many entities",
        ),
        "fan.dxf": (_drawn(_fan), "too many crossings"),
        "hatch_of_lines.dxf": (_drawn(_hatch_of_lines), ""),
        "hatch_of_squares.dxf": (_drawn(_hatch_of_squares), "support"),
        "arcs_of_one_circle.dxf": (_drawn(_circles), "arcs of one circle"),
        "spline.dxf": (_drawn(_spline), ""),
    }


def _ifc(tail: str) -> Callable[[Path], None]:
    head = "ISO-10303-21;HEADER;FILE_DESCRIPTION((''),'2;1');FILE_NAME('','',(''),(''),'','','');FILE_SCHEMA(('IFC4'));"
    return _text(lambda: head + "ENDSEC;DATA;" + tail + "ENDSEC;END-ISO-10303-21;")


def _mapped(levels: int, copies: int) -> str:
    unit = "#1=IFCSIUNIT(*,.LENGTHUNIT.,$,.METRE.);#2=IFCUNITASSIGNMENT((#1));"
    unit += "#3=IFCPROJECT('0aaaaaaaaaaaaaaaaaaaa1',$,'p',$,$,$,$,(#7),#2);"
    place = "#4=IFCCARTESIANPOINT((0.,0.,0.));#5=IFCAXIS2PLACEMENT3D(#4,$,$);"
    place += "#6=IFCCARTESIANTRANSFORMATIONOPERATOR3D($,$,#4,$,$);"
    place += "#7=IFCGEOMETRICREPRESENTATIONCONTEXT($,'Model',3,1.E-5,#5,$);#8=IFCCARTESIANPOINT((0.,0.));"
    place += "#9=IFCAXIS2PLACEMENT2D(#8,$);#10=IFCRECTANGLEPROFILEDEF(.AREA.,$,#9,1.,1.);#11=IFCDIRECTION((0.,0.,1.));"
    place += "#12=IFCEXTRUDEDAREASOLID(#10,#5,#11,1.);#20=IFCSHAPEREPRESENTATION(#7,'Body','SweptSolid',(#12));"
    body, last, number = "", 20, 100
    for _ in range(levels):
        body += f"#{number}=IFCREPRESENTATIONMAP(#5,#{last});"
        items = []
        for k in range(copies):
            body += f"#{number + 1 + k}=IFCMAPPEDITEM(#{number},#6);"
            items.append(f"#{number + 1 + k}")
        last = number + copies + 1
        body += f"#{last}=IFCSHAPEREPRESENTATION(#7,'Body','MappedRepresentation',({','.join(items)}));"
        number = last + 1
    end = f"#{number}=IFCPRODUCTDEFINITIONSHAPE($,$,(#{last}));#{number + 1}=IFCLOCALPLACEMENT($,#5);"
    end += f"#{number + 2}=IFCWALL('0aaaaaaaaaaaaaaaaaaaa2',$,'w',$,$,#{number + 1},#{number},$,$);"
    return unit + place + body + end


def _clipped(levels: int) -> str:
    """A wall from which a half-space is cut some thousand times."""
    plain = _mapped(0, 0)
    body = "#50=IFCPLANE(#5);#51=IFCHALFSPACESOLID(#50,.T.);"
    last = 12
    for k in range(levels):
        body += f"#{1000 + k}=IFCBOOLEANCLIPPINGRESULT(.DIFFERENCE.,#{last},#51);"
        last = 1000 + k
    return plain.replace("'SweptSolid',(#12)", f"'Clipping',(#{last})") + body


def _rhino(levels: int, copies: int) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        import rhino3dm as rhino

        model = rhino.File3dm()
        box = rhino.Mesh()
        for x, y in SQUARE:
            box.Vertices.Add(x, y, 0.0)
        box.Faces.AddFace(0, 1, 2, 3)
        point = rhino.Point3d(0, 0, 0)
        last = model.InstanceDefinitions.Add("B0", "", "", "", point, (box,), (rhino.ObjectAttributes(),))
        for level in range(1, levels + 1):
            below = model.InstanceDefinitions.FindIndex(last)
            uses = tuple(rhino.InstanceReference(below.Id, rhino.Transform.Identity()) for _ in range(copies))
            attributes = tuple(rhino.ObjectAttributes() for _ in uses)
            last = model.InstanceDefinitions.Add(f"B{level}", "", "", "", point, uses, attributes)
        whole = rhino.InstanceReference(model.InstanceDefinitions.FindIndex(last).Id, rhino.Transform.Identity())
        model.Objects.AddInstanceObject(whole)
        model.Write(str(path), 8)

    return write


def _step(levels: int, copies: int) -> str:
    unit = "#1=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT($,.METRE.));"
    unit += "#2=(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNIT_ASSIGNED_CONTEXT((#1))REPRESENTATION_CONTEXT('',''));"
    body = ""
    for k in range(levels + 1):
        body += f"#{10 + 10 * k}=PRODUCT('p{k}','p{k}','',());"
        body += f"#{11 + 10 * k}=PRODUCT_DEFINITION_FORMATION('','',#{10 + 10 * k});"
        body += f"#{12 + 10 * k}=PRODUCT_DEFINITION('','',#{11 + 10 * k},$);"
        for j in range(copies if k else 0):
            number = 10_000 + 100 * k + j
            body += f"#{number}=NEXT_ASSEMBLY_USAGE_OCCURRENCE('','','',#{12 + 10 * k},#{2 + 10 * k},$);"
    return f"ISO-10303-21;HEADER;ENDSEC;DATA;{unit}{body}ENDSEC;END-ISO-10303-21;"


def _solids() -> dict[str, tuple[Callable[[Path], None], str]]:
    deep = "ISO-10303-21;HEADER;ENDSEC;DATA;#1=A(" + "(" * 100_000 + ")" * 100_000 + ");ENDSEC;"
    ply = b"ply\nformat binary_little_endian 1.0\nelement vertex 2000000000\nproperty float x\nproperty float y\n"
    ply += b"property float z\nelement face 2000000000\nproperty list uchar int vertex_indices\nend_header\n\0\0\0\0"
    return {
        "mapped.ifc": (_ifc(_mapped(10, 10)), "mapped items unfold"),
        "mapped_two.ifc": (_ifc(_mapped(30, 2)), "mapped items unfold"),
        "clipped.ifc": (_ifc(_clipped(3000)), "cut 3000 times"),
        "cuts.ifc": (_ifc(_clipped(80)), ""),
        "blocks.3dm": (_rhino(10, 10), "too many"),
        "blocks_two.3dm": (_rhino(15, 2), "too many"),
        "assembly.step": (_text(lambda: _step(30, 2)), "too many parts"),
        "assembly_ten.step": (_text(lambda: _step(12, 10)), "too many parts"),
        "brackets.step": (_text(lambda: deep), "too deeply"),
        "face.obj": (_text(lambda: "v 0 0 0\nv 1 0 0\nv 0 1 0\nf" + " 1 2 3" * 150_000 + "\n"), ""),
        "faces.obj": (_text(lambda: "v 0 0 0\nv 1 0 0\nv 0 1 0\n" + "f 1 2 3\n" * 400_000), "too many faces"),
        "claims.stl": (
            lambda path: path.write_bytes(b"\0" * 80 + struct.pack("<I", 4_000_000_000) + b"\0" * 50) and None,
            "",
        ),
        "claims.ply": (lambda path: path.write_bytes(ply) and None, ""),
        "deep.json": (_text(lambda: '{"node":' + "[" * 500_000), "nested too deeply"),
        "nodes.json": (_text(lambda: json.dumps({"node": {str(k): {"block": {}} for k in range(70_000)}})), ""),
        "rows.csv": (_text(lambda: "id,x,y\n" + "a,1,2\n" * 400_000), "too many corners"),
    }


def bombs() -> dict[str, tuple[Callable[[Path], None], str]]:
    """Return by name how each file is written, and words of its refusal ("" where any will do)."""
    return {**_svg(), **_dxf(), **_solids()}
