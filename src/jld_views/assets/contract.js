// @ts-check
/**
 * What Python sends and the page reads. It is stated in page_contract.py, which also gives the JSON schema that tests
 * hold data against. Lengths and forces are in the units of the scene.
 */

// Generated from page_contract.py by `python -m tools.page_contract`; do not edit.

export const FORMAT = "jld-page";
export const VERSION = 1;

/**
 * @typedef {object} CaseSolution Solution of one layout under one load case; null where unknown.
 * @property {string} name Name of the case; the empty string in a scene with a single load.
 * @property {number} required Required load factor, by which λ is divided.
 * @property {number | null} load_factor
 * @property {[number | null, number | null]} bracket
 * @property {number | null} gap
 * @property {string} status
 * @property {string} friction
 * @property {number[][] | null} forces One row for each face.
 * @property {number[] | null} utilisation 0 … 1 for each face.
 * @property {Point[] | null} pressure Centre of pressure of each face.
 * @property {boolean[] | null} on_face True if that centre lies on the face.
 * @property {Point[] | null} vectors Force of each face, with the sign that runs down the load path.
 * @property {number[] | null} members Tension of each member, of a pin its shear.
 * @property {Point[][]} thrust Pieces of the thrust line.
 * @property {number[][] | null} mechanism Velocities of each element about its centroid.
 * @property {number} scale Factor on the velocities for a picture.
 * @property {string[] | null} movements What each face does in the mechanism.
 * @property {Point[] | null} places Where it does that, at rest.
 */

/**
 * @typedef {object} Column Column of the table of layouts, with one value per row; null where not computed.
 * @property {string} name Name as in results.csv.
 * @property {string} title
 * @property {string} unit
 * @property {"number" | "integer" | "text"} kind
 * @property {(number | string | null)[]} values
 */

/**
 * @typedef {object} Curve Best load factor of a search against solves and time: lists with one entry per point.
 * @property {string} name
 * @property {number[]} solves
 * @property {number[]} seconds
 * @property {number[]} best
 */

/**
 * @typedef {object} Edge
 * @property {number} element
 * @property {Point} from
 * @property {Point} to
 */

/**
 * @typedef {object} Element Element of the assembly: name, shape and weight.
 * @property {string} id
 * @property {boolean} support
 * @property {Point[]} shape Planar: the outline, counter-clockwise; spatial: the vertices.
 * @property {number[][]} faces Spatial: vertex numbers of each face, outward; planar: empty.
 * @property {Point} centroid
 * @property {number} weight Magnitude of its self-weight.
 */

/**
 * @typedef {object} Face Interface of two elements of the assembly.
 * @property {[number, number]} elements Numbers of its two elements; the normal runs from the first to the second.
 * @property {Point[]} polygon
 * @property {Point} origin
 * @property {Point} normal
 * @property {number} area Planar: length times thickness.
 * @property {boolean} candidate True if a search may choose its label.
 */

/**
 * @typedef {object} Fact A fact of the scene or the search, shown by name.
 * @property {string} name
 * @property {string} value
 */

/**
 * @typedef {object} Load Live load as a page draws it: force, force on all bodies, or couple.
 * @property {string} case
 * @property {"live" | "body" | "couple"} kind
 * @property {string} element Name of the element, or the empty string.
 * @property {Point} at Tip of the arrow, or middle of the couple.
 * @property {number[]} vector Force, or (for a couple) its moment.
 */

/**
 * @typedef {object} Look Colours, dashes and marks by which the page draws, the same as in figures of matplotlib.
 * @property {string[]} tints
 * @property {string} plain
 * @property {string} support
 * @property {string} hatch
 * @property {string} ink
 * @property {string} soft
 * @property {string} rest
 * @property {string} load
 * @property {string} press
 * @property {string} member
 * @property {string[]} used
 * @property {string} thrust
 * @property {number[]} thrust_dash
 * @property {number[]} inner_dash
 * @property {Record<string, Mark>} movements
 * @property {Record<string, Mark>} yielding
 * @property {Record<string, Mark>} evidence
 * @property {string} front
 * @property {number} small Share of the largest force below which an arrow is left out.
 * @property {number} yields Utilisation from which a face is marked.
 * @property {[number, number]} eye Azimuth and elevation of spatial views, degrees.
 */

/**
 * @typedef {object} Mark Marker of the drawings: shape, colours #rrggbb, and legend text.
 * @property {"circle" | "diamond" | "thin diamond" | "triangle" | "cross"} shape
 * @property {string} fill
 * @property {string} edge
 * @property {string} meaning
 */

/**
 * @typedef {object} Member Tie, tendon, pin or pressure of fill: a line through points of elements.
 * @property {string} name
 * @property {"tie" | "tendon" | "pin" | "fill"} kind
 * @property {number[]} elements Number of the element of each point.
 * @property {Point[]} points
 */

/**
 * @typedef {object} Notebook Additional data of a page in a notebook: materials with which the kernel solves again.
 * @property {Record<string, unknown>} materials Materials of the scene, which the sliders begin with.
 * @property {string} why Why the sliders do nothing without a kernel.
 * @property {boolean} fixed True if the sliders do nothing with a kernel either.
 */

/**
 * @typedef {object} Picture Picture drawn by Python, which the page itself cannot draw.
 * @property {string} title
 * @property {string} png Base64 of a PNG file.
 */

/** @typedef {number[]} Point */

/**
 * @typedef {object} Solution Solution of one layout: λ, bracket, status, and a solution for each load case.
 * @property {string} labelling Letters d, i and v (beside a cell that is left out), one for each face.
 * @property {number | null} load_factor Load factor λ; with several load cases the least λ over what is required.
 * @property {[number | null, number | null]} bracket
 * @property {string} status
 * @property {number} governing Number of the case that governs.
 * @property {CaseSolution[]} cases
 */

/**
 * @typedef {object} Structure Elements and faces of the scene, in the order of the assembly.
 * @property {2 | 3} dimension
 * @property {Units} units
 * @property {number} size Largest side of the bounding box.
 * @property {number} typical Median size of a free element: the yardstick of marks.
 * @property {Element[]} elements
 * @property {Face[]} faces
 * @property {Edge[]} edges Planar: pieces of outline that touch no other element.
 * @property {string[]} resultants Names of the numbers in a row of forces.
 * @property {([number, number])[]} touching Pairs of supports that share a face: they are of one block.
 * @property {Member[]} members Ties, tendons, pins and pressures of fill.
 * @property {Point[][]} fill Planar: outlines of fill above the elements.
 */

/**
 * @typedef {object} Table Table of layouts that the page shows, by columns, with the labels of each row as bits.
 * @property {number} rows
 * @property {Column[]} columns
 * @property {string} labellings Base64 of the bits of all labellings, a whole number of bytes a row, 1 = dry.
 * @property {string} beside Base64 of bits like those of labellings, 1 = the face is beside a cell that is left out; "" where none is.
 * @property {("proven" | "found" | "visited")[]} evidence Evidence of each row.
 * @property {string} count Name of the column that the picture weighs against λ.
 * @property {"max" | "min"} sense Better direction of the count.
 * @property {boolean} line True if the front is a line in that picture, because it weighs λ against one count.
 * @property {string[]} counts Names of the columns that the picture may have across.
 * @property {number} left_out Rows of the results that the page does not hold.
 */

/**
 * @typedef {object} Units Names of the units of the scene.
 * @property {string} length
 * @property {string} force
 */

/**
 * @typedef {object} PageData All data of a page, for a report of a search, a single scene or the studio.
 * @property {"jld-page"} format
 * @property {1} version
 * @property {"report" | "studio"} kind
 * @property {string} title
 * @property {Fact[]} facts
 * @property {string[]} warnings
 * @property {string} how Sentence on how to get the forces of a layout that the page holds none of; {rank} stands for its rank.
 * @property {Look} look
 * @property {Structure} structure
 * @property {string[]} cases Names of the load cases; one empty name in a scene with a single load.
 * @property {Load[]} loads
 * @property {Table | null} table
 * @property {Record<string, Solution>} solutions Solutions by number of the row.
 * @property {Curve[]} convergence
 * @property {Picture[]} pictures Pictures of what the page itself cannot draw: stress and velocity fields.
 * @property {Record<string, unknown>} scene The scene file.
 * @property {Record<string, unknown>} summary Content of summary.json, or empty.
 * @property {Record<string, unknown> | null} studio Data that only the studio has.
 * @property {Notebook | null} notebook Data that only a page in a notebook has.
 */

/** Keys that each object must have, by the name of its type. */
export const REQUIRED = Object.freeze({
  CaseSolution: ["name", "required", "load_factor", "bracket", "gap", "status", "friction", "forces", "utilisation", "pressure", "on_face", "vectors", "members", "thrust", "mechanism", "scale", "movements", "places"],
  Column: ["name", "title", "unit", "kind", "values"],
  Curve: ["name", "solves", "seconds", "best"],
  Edge: ["element", "from", "to"],
  Element: ["id", "support", "shape", "faces", "centroid", "weight"],
  Face: ["elements", "polygon", "origin", "normal", "area", "candidate"],
  Fact: ["name", "value"],
  Load: ["case", "kind", "element", "at", "vector"],
  Look: ["tints", "plain", "support", "hatch", "ink", "soft", "rest", "load", "press", "member", "used", "thrust", "thrust_dash", "inner_dash", "movements", "yielding", "evidence", "front", "small", "yields", "eye"],
  Mark: ["shape", "fill", "edge", "meaning"],
  Member: ["name", "kind", "elements", "points"],
  Notebook: ["materials", "why", "fixed"],
  Picture: ["title", "png"],
  Solution: ["labelling", "load_factor", "bracket", "status", "governing", "cases"],
  Structure: ["dimension", "units", "size", "typical", "elements", "faces", "edges", "resultants", "touching", "members", "fill"],
  Table: ["rows", "columns", "labellings", "beside", "evidence", "count", "sense", "line", "counts", "left_out"],
  Units: ["length", "force"],
  PageData: ["format", "version", "kind", "title", "facts", "warnings", "how", "look", "structure", "cases", "loads", "table", "solutions", "convergence", "pictures", "scene", "summary", "studio", "notebook"],
});

// End of what is generated.

/**
 * One line that says what is wrong with data, or null.
 * @param {any} data
 * @returns {string | null}
 */
export function complaint(data) {
  if (data === null || typeof data !== "object") return "the data of this page is no object";
  if (data.format !== FORMAT) return "the data of this page has another format";
  if (data.version !== VERSION) return `the data has version ${data.version}, this page reads version ${VERSION}`;
  /** @param {string} name @param {any} value @param {string} at */
  const lacks = (name, value, at) => {
    for (const key of REQUIRED[/** @type {keyof typeof REQUIRED} */ (name)]) {
      if (value === null || typeof value !== "object" || !(key in value)) return `${at} lacks ${key}`;
    }
    return null;
  };
  const parts = [
    ["PageData", data, "the page"],
    ["Look", data.look, "look"],
    ["Structure", data.structure, "structure"],
    ...(data.structure?.elements ?? []).map((/** @type {any} */ e, /** @type {number} */ k) => ["Element", e, `element ${k}`]),
    ...(data.structure?.faces ?? []).map((/** @type {any} */ f, /** @type {number} */ k) => ["Face", f, `face ${k}`]),
    ...(data.loads ?? []).map((/** @type {any} */ l, /** @type {number} */ k) => ["Load", l, `load ${k}`]),
    ...(data.table ? [["Table", data.table, "table"]] : []),
    ...(data.table?.columns ?? []).map((/** @type {any} */ c, /** @type {number} */ k) => ["Column", c, `column ${k}`]),
    ...Object.entries(data.solutions ?? {}).flatMap(([row, s]) => [
      ["Solution", s, `solution ${row}`],
      ...(s.cases ?? []).map((/** @type {any} */ c) => ["CaseSolution", c, `a case of solution ${row}`]),
    ]),
  ];
  for (const [name, value, at] of parts) {
    const found = lacks(name, value, at);
    if (found) return found;
  }
  return null;
}
