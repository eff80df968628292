// @ts-check
/** The page of a finished search. */
import { read, write } from "./address.js";
import { bytesOf, lettersOf } from "./blocks.js";
import { convergence } from "./curves.js";
import { embedded } from "./data.js";
import { byId, el, say, shown } from "./dom.js";
import { downloads, facts, pictures } from "./facts.js";
import { Kernel } from "./kernel.js";
import { Scatter } from "./scatter.js";
import { LayoutTable } from "./table.js";
import { Viewer } from "./viewer.js";
import { verdict } from "./words.js";

/** @param {import("./contract.js").PageData} data */
function start(data) {
  const { table } = data;
  document.title = `${data.title} – jld`;
  byId("title").textContent = data.title;
  facts(byId("facts"), data);
  downloads(byId("downloads"), data);
  byId("fields").hidden = data.pictures.length === 0;
  pictures(byId("field-pictures"), data.pictures);
  byId("history").hidden = data.convergence.length === 0;
  const ranked = table?.columns.find((c) => c.name === "load_factor")?.title ?? "λ";
  convergence(byId("convergence"), data.convergence, data.look.front, ranked);
  let remember = () => {};
  const viewer = new Viewer(byId("viewer"), data, { changed: () => remember() });
  let redraw = () => {};
  byId("materials-card").hidden = !data.notebook;
  const kernel = data.notebook ? new Kernel(byId("materials"), data, () => redraw()) : null;
  if (kernel) alone();
  const put = (/** @type {import("./viewer.js").Layout[]} */ layouts) => viewer.set(kernel ? kernel.now(layouts) : layouts);
  const given = read();
  if (!table) {
    const own = data.solutions["0"];
    for (const id of ["picture", "layouts", "history"]) byId(id).hidden = true;
    redraw = () => put([{ name: "the labels of the scene", labelling: own?.labelling ?? "", solution: own ?? null }]);
    redraw();
    if (given.view) viewer.setView(given.view);
    return viewer;
  }
  const bits = bytesOf(table.labellings);
  const beside = bytesOf(table.beside);
  const column = (/** @type {string} */ name) => table.columns.find((c) => c.name === name)?.values ?? [];
  const ranks = column("rank");
  let [selected, compared] = [-1, -1];

  /** Row of results.csv, from 1, which commands take as --rank: the strongest rows are here without a gap, and where one
   * lies beyond them its rank says so. @param {number} row */
  const number = (row) => Math.max(Number(ranks[row] ?? 0), row + 1);
  /** Do others share its rank? @param {number} row */
  const tied = (row) => ranks[row] !== null && (ranks[row - 1] === ranks[row] || ranks[row + 1] === ranks[row]);

  /** @param {number} row @returns {import("./viewer.js").Layout} */
  const layout = (row) => {
    const rank = ranks[row];
    const solution = data.solutions[row] ?? null;
    const status = String(column("status")[row] ?? "");
    const bracket = /** @type {[number | null, number | null]} */ ([column("bracket_lo")[row] ?? null, column("bracket_hi")[row] ?? null]);
    return {
      name: typeof rank === "number" ? `Rank ${rank}${tied(row) ? `, row ${number(row)}` : ""}, ${table.evidence[row]}` : `Row ${row + 1}, ${status}`,
      labelling: solution?.labelling ?? lettersOf(bits, row, data.structure.faces.length, beside),
      solution,
      line: verdict({ load_factor: /** @type {number | null} */ (column("load_factor")[row] ?? null), bracket, status }),
      lacking: `This page holds no forces of this layout. ${data.how.replaceAll("{rank}", String(number(row)))}`,
    };
  };
  remember = () => {
    const place = (/** @type {number} */ row) => (row >= 0 && ranks.indexOf(ranks[row]) === row && ranks[row] !== null ? String(ranks[row]) : `r${row}`);
    const at = selected < 0 ? "" : place(selected);
    write({
      rank: at && !at.startsWith("r") ? at : null,
      row: at.startsWith("r") ? at.slice(1) : null,
      compare: compared < 0 ? null : place(compared),
      view: viewer.view === "labels" ? null : viewer.view,
      case: viewer.caseGiven && data.cases.length > 1 ? data.cases[viewer.case] : null,
      x: scatter.count === table.count ? null : scatter.count,
    });
  };
  redraw = () => put([selected, compared].filter((row) => row >= 0).map(layout));
  const show = () => {
    redraw();
    grid?.select(selected, compared);
    scatter.select(selected, compared);
    byId("uncompare").hidden = compared < 0;
    remember();
  };
  const pick = (/** @type {number} */ row) => {
    selected = row;
    show();
    say(`${layout(row).name}: λ ${shown(column("load_factor")[row])}`);
  };
  const compare = (/** @type {number} */ row) => {
    compared = compared === row ? -1 : row;
    show();
    say(compared < 0 ? "Not comparing." : `Compared with ${layout(row).name}`);
  };
  // each tells the other, so that neither may speak before both are there
  /** @type {LayoutTable | null} */
  let grid = null;
  const scatter = new Scatter(byId("scatter"), table, data.look, {
    pick, compare, brush: (test) => grid?.setBrush(test), across: () => remember(),
  });
  grid = new LayoutTable(byId("table"), table, bits, data.structure.faces.length, {
    pick, compare, filtered: (rows) => scatter.filter(rows),
  });
  byId("compare-hint").append(
    "Shift and click, or C in the table, puts a second layout beside the first. ",
    el("button", { type: "button", id: "pin", onclick: () => { if (selected >= 0) compare(selected); } }, "keep this one to compare"),
    el("button", { type: "button", id: "uncompare", hidden: true, onclick: () => { compared = -1; show(); } }, "stop comparing"),
  );
  if (table.left_out) {
    byId("layouts").querySelector("h2").after(el("p", { class: "hint" }, `${table.left_out} weaker layouts are in results.csv only, so that this page stays small.`));
  }
  const find = (/** @type {string} */ text) => {
    const first = ranks.indexOf(Number(text));
    // a rank that others share is that of the first of them; the second of two is found by its number
    const row = text.startsWith("r") ? Number(text.slice(1)) : first >= 0 ? first : Number(text) - 1;
    return row >= 0 && row < table.rows ? row : -1;
  };
  const goTo = () => {
    const at = read();
    selected = at.rank ? find(at.rank) : at.row ? find(`r${at.row}`) : -1;
    if (selected < 0) selected = table.rows ? 0 : -1;
    compared = at.compare ? find(at.compare) : -1;
    const number = at.case ? data.cases.indexOf(at.case) : -1;
    if (number >= 0) viewer.setCase(number);
    if (at.x) scatter.setCount(at.x);
    viewer.view = /** @type {"labels"} */ (["forces", "mechanism"].includes(at.view) ? at.view : "labels");
    show();
  };
  goTo();
  window.addEventListener("hashchange", goTo);
  return viewer;
}

/** In a notebook, facts, picture and table beside the frame are for where no script runs. */
function alone() {
  document.body.classList.add("notebook");
  const beside = /** @type {HTMLElement | null | undefined} */ (window.frameElement?.parentElement?.querySelector("[data-plain]"));
  if (beside) beside.style.display = "none";
}

/** @param {unknown} error */
function failed(error) {
  byId("title").textContent = "This page could not be shown";
  byId("facts").replaceChildren(el("p", { class: "warning", role: "alert" }, error instanceof Error ? error.message : String(error)));
  document.body.dataset.ready = "failed";
}

try {
  const viewer = start(await embedded());
  document.body.dataset.ready = "yes";
  if (viewer.layouts.length === 0) say("This search found no layout.");
} catch (error) {
  failed(error);
}
