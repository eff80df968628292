// @ts-check
/** What is written into the head of a column, as a test of its values. */

/**
 * Numbers: `>1.2`, `>=1`, `<3`, `=5`, `1..3`; text: any part of it, `=` before all of it. Null where it says nothing
 * that can be understood.
 * @param {string} text
 * @param {"number" | "integer" | "text"} kind
 * @returns {((value: number | string | null) => boolean) | null}
 */
export function filterOf(text, kind) {
  const wish = text.trim();
  if (kind === "text") {
    if (wish.startsWith("=")) return (value) => String(value ?? "") === wish.slice(1).trim();
    const part = wish.toLowerCase();
    return (value) => String(value ?? "").toLowerCase().includes(part);
  }
  const plain = wish.replaceAll("−", "-");
  const number = "(-?\\d+(?:\\.\\d*)?(?:e[-+]?\\d+)?|-?\\.\\d+)";
  const range = plain.match(new RegExp(`^${number}\\s*\\.\\.\\s*${number}$`, "i"));
  if (range) {
    const [low, high] = [Number(range[1]), Number(range[2])];
    return (value) => typeof value === "number" && value >= low && value <= high;
  }
  const found = plain.match(new RegExp(`^(<=|>=|<|>|=|)\\s*${number}$`, "i"));
  if (!found) return null;
  const bound = Number(found[2]);
  /** @type {Record<string, (v: number) => boolean>} */
  const tests = { "<": (v) => v < bound, ">": (v) => v > bound, "<=": (v) => v <= bound, ">=": (v) => v >= bound, "=": (v) => v === bound, "": (v) => v === bound };
  return (value) => typeof value === "number" && tests[found[1]](value);
}

/**
 * Rows in the order of a column, empty values last.
 * @param {number[]} rows
 * @param {(number | string | null)[]} values
 * @param {boolean} down
 */
export function sorted(rows, values, down) {
  const sense = down ? -1 : 1;
  return rows.slice().sort((i, j) => {
    const [a, b] = [values[i], values[j]];
    if (a === b) return i - j;
    if (a === null) return 1;
    if (b === null) return -1;
    return a < b ? -sense : sense;
  });
}
