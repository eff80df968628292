// @ts-check
/**
 * What Python sends and the page reads. The same contract stands as a JSON schema in page.schema.json; a test
 * compares the two, so that neither changes alone. Lengths and forces are in the units of the scene.
 */

/** @typedef {number[]} Point two or three coordinates */

/**
 * @typedef {object} Element
 * @property {string} id
 * @property {boolean} support
 * @property {Point[]} shape planar: the outline, counter-clockwise; spatial: the vertices
 * @property {number[][]} faces spatial: vertex numbers of each face, outward; planar: empty
 * @property {Point} centroid
 * @property {number} weight magnitude of its self-weight
 */

/**
 * @typedef {object} Face
 * @property {[number, number]} elements numbers of its two elements; the normal runs from the first to the second
 * @property {Point[]} polygon
 * @property {Point} origin
 * @property {Point} normal
 * @property {number} area planar: length times thickness
 * @property {boolean} candidate whether a search may choose its label
 */

/**
 * @typedef {object} Structure
 * @property {2 | 3} dimension
 * @property {{length: string, force: string}} units
 * @property {number} size largest side of the bounding box
 * @property {number} typical median size of a free element: the yardstick of marks
 * @property {Element[]} elements
 * @property {Face[]} faces
 * @property {{element: number, from: Point, to: Point}[]} edges planar: pieces of outline that touch no other element
 * @property {string[]} resultants names of the numbers in a row of forces
 * @property {[number, number][]} touching pairs of supports that share a face: they are of one block
 */

/**
 * @typedef {object} Load
 * @property {string} case
 * @property {"live" | "body" | "couple"} kind
 * @property {string} element id, or the empty string
 * @property {Point} at tip of the arrow, or middle of the couple
 * @property {Point} vector force, or (for a couple) its moment
 */

/**
 * @typedef {object} CaseSolution what is proven of one layout under one load case
 * @property {string} name the empty string where a scene has one case only
 * @property {number} required what its λ is divided by
 * @property {number | null} load_factor
 * @property {[number | null, number | null]} bracket
 * @property {number | null} gap
 * @property {string} status
 * @property {string} friction
 * @property {number[][] | null} forces one row for each face
 * @property {number[] | null} utilisation 0 … 1 for each face
 * @property {Point[] | null} pressure centre of pressure of each face
 * @property {boolean[] | null} on_face whether that centre lies on the face
 * @property {Point[] | null} vectors force of each face, with the sign that runs down the load path
 * @property {Point[][]} thrust pieces of the thrust line
 * @property {number[][] | null} mechanism velocities of each element about its centroid
 * @property {number} scale factor on the velocities for a picture
 * @property {string[] | null} movements what each face does in the mechanism
 * @property {Point[] | null} places where it does that, at rest
 */

/**
 * @typedef {object} Solution
 * @property {string} labelling letters d and i, one for each face
 * @property {number | null} load_factor λ; with several load cases the least λ over what is required
 * @property {[number | null, number | null]} bracket
 * @property {string} status
 * @property {number} governing number of the case that governs
 * @property {CaseSolution[]} cases
 */

/**
 * @typedef {object} Column
 * @property {string} name as in results.csv
 * @property {string} title
 * @property {string} unit
 * @property {"number" | "integer" | "text"} kind
 * @property {(number | string | null)[]} values
 */

/**
 * @typedef {object} Table
 * @property {number} rows
 * @property {Column[]} columns
 * @property {string} labellings base64 of the bits of all labellings, a whole number of bytes a row, 1 = dry
 * @property {string} beside base64 of bits like those of labellings, 1 = the face is beside a cell that is left out; "" where none is
 * @property {string[]} evidence proven, found or visited, for each row
 * @property {string} count name of the column that the picture weighs against λ
 * @property {string} sense max or min: the better direction of the count
 * @property {boolean} line whether the front is a line in that picture: it weighs λ against one count
 * @property {string[]} counts names of the columns that the picture may have across
 * @property {number} left_out rows of the results that the page does not hold
 */

/**
 * @typedef {object} Mark
 * @property {"circle" | "diamond" | "thin diamond" | "triangle" | "cross"} shape
 * @property {string} fill
 * @property {string} edge
 * @property {string} meaning
 */

/**
 * @typedef {object} Look drawing rules, the same for the pictures of matplotlib
 * @property {string[]} tints
 * @property {string} plain
 * @property {string} support
 * @property {string} hatch
 * @property {string} ink
 * @property {string} soft
 * @property {string} rest
 * @property {string} load
 * @property {string} press
 * @property {string[]} used
 * @property {string} thrust
 * @property {number[]} thrust_dash
 * @property {number[]} inner_dash
 * @property {Record<string, Mark>} movements
 * @property {Record<string, Mark>} yielding
 * @property {Record<string, Mark>} evidence
 * @property {string} front
 * @property {number} small share of the largest force below which an arrow is left out
 * @property {number} yields utilisation from which a face is marked
 * @property {[number, number]} eye azimuth and elevation of spatial views, degrees
 */

/**
 * @typedef {object} Fact
 * @property {string} name
 * @property {string} value
 */

/**
 * @typedef {object} Curve
 * @property {string} name
 * @property {number[]} solves
 * @property {number[]} seconds
 * @property {number[]} best
 */

/**
 * @typedef {object} PageData
 * @property {"jld-page"} format
 * @property {number} version
 * @property {"report" | "studio"} kind
 * @property {string} title
 * @property {Fact[]} facts
 * @property {string[]} warnings
 * @property {string} how how to get the forces of a layout that the page holds none of; {rank} stands for its rank
 * @property {Look} look
 * @property {Structure} structure
 * @property {string[]} cases names of the load cases; one empty name where there is one only
 * @property {Load[]} loads
 * @property {Table | null} table
 * @property {Record<string, Solution>} solutions by number of the row
 * @property {Curve[]} convergence
 * @property {Record<string, unknown>} scene the scene file
 * @property {Record<string, unknown>} summary summary.json
 * @property {Record<string, unknown> | null} studio what the studio adds
 */

/** Keys that each object must have, by the name of its type. */
export const REQUIRED = Object.freeze({
  PageData: [
    "format", "version", "kind", "title", "facts", "warnings", "how", "look", "structure", "cases", "loads",
    "table", "solutions", "convergence", "scene", "summary", "studio",
  ],
  Structure: ["dimension", "units", "size", "typical", "elements", "faces", "edges", "resultants", "touching"],
  Element: ["id", "support", "shape", "faces", "centroid", "weight"],
  Face: ["elements", "polygon", "origin", "normal", "area", "candidate"],
  Load: ["case", "kind", "element", "at", "vector"],
  Table: ["rows", "columns", "labellings", "beside", "evidence", "count", "sense", "line", "counts", "left_out"],
  Column: ["name", "title", "unit", "kind", "values"],
  Solution: ["labelling", "load_factor", "bracket", "status", "governing", "cases"],
  CaseSolution: [
    "name", "required", "load_factor", "bracket", "gap", "status", "friction", "forces", "utilisation", "pressure", "on_face",
    "vectors", "thrust", "mechanism", "scale", "movements", "places",
  ],
  Look: [
    "tints", "plain", "support", "hatch", "ink", "soft", "rest", "load", "press", "used", "thrust", "thrust_dash",
    "inner_dash", "movements", "yielding", "evidence", "front", "small", "yields", "eye",
  ],
  Mark: ["shape", "fill", "edge", "meaning"],
  Curve: ["name", "solves", "seconds", "best"],
  Fact: ["name", "value"],
});

export const VERSION = 1;

/**
 * One line that says what is wrong with data, or null.
 * @param {any} data
 * @returns {string | null}
 */
export function complaint(data) {
  if (data === null || typeof data !== "object") return "the data of this page is no object";
  if (data.format !== "jld-page") return "the data of this page has another format";
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
