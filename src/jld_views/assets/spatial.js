// @ts-check
/** A spatial structure in WebGL: turn, zoom, explode, cut, see through; labels, forces or mechanism of one layout. */
import * as THREE from "./vendor/three.js";
import { coloursOf, blocksOf, goneOf } from "./blocks.js";
import { beside } from "./planar.js";
import { el } from "./dom.js";
import { ramp } from "./marks.js";

/** @typedef {import("./contract.js").PageData} PageData */
/** @typedef {import("./planar.js").Drawing} Drawing */

/** Whether this browser can show spatial structures at all. */
export function canDraw() {
  try {
    return Boolean(document.createElement("canvas").getContext("webgl2"));
  } catch {
    return false;
  }
}

export class SpatialFigure {
  /**
   * @param {HTMLElement} host
   * @param {PageData} data
   */
  constructor(host, data) {
    this.host = host;
    this.data = data;
    const { structure } = data;
    this.size = structure.size;
    this.canvas = el("canvas", { class: "figure spatial", tabindex: 0, role: "img" });
    this.node = this.canvas;
    this.controlsRow = el("div", { class: "spatial-controls" });
    host.replaceChildren(this.canvas, this.controlsRow);
    this.renderer = new THREE.WebGLRenderer({ canvas: this.canvas, antialias: true, alpha: true, preserveDrawingBuffer: true });
    this.renderer.localClippingEnabled = true;
    this.scene = new THREE.Scene();
    this.scene.add(new THREE.AmbientLight(0xffffff, 2.2));
    const sun = new THREE.DirectionalLight(0xffffff, 1.5);
    sun.position.set(0.6, -1, 1.6);
    this.scene.add(sun);
    const points = structure.elements.flatMap((element) => element.shape);
    this.low = [0, 1, 2].map((axis) => points.reduce((m, p) => Math.min(m, p[axis]), Infinity));
    this.high = [0, 1, 2].map((axis) => points.reduce((m, p) => Math.max(m, p[axis]), -Infinity));
    this.middle = this.low.map((low, k) => 0.5 * (low + this.high[k]));
    this.radius = 0.5 * Math.hypot(...this.low.map((low, k) => this.high[k] - low));
    this.camera = new THREE.OrthographicCamera(-1, 1, 1, -1, -20 * this.radius, 40 * this.radius);
    this.camera.up.set(0, 0, 1);
    this.controls = new THREE.OrbitControls(this.camera, this.canvas);
    this.controls.enableZoom = true;
    this.controls.addEventListener("change", () => this.render());
    this.home();
    /** @type {any[]} */
    this.loose = [];
    /** what is made once and drawn in every layout @type {Map<string, any>} */
    this.kept = new Map();
    this.explode = 0;
    this.opacity = 1;
    this.cut = { axis: -1, share: 1 };
    this.share = 1;
    /** @type {number | undefined} */
    this.frame = undefined;
    this.#controlPanel();
    this.watch = new ResizeObserver(() => this.#resize());
    this.watch.observe(this.canvas);
    this.canvas.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => this.#key(event));
    this.#wheel();
  }

  /** The view that the pictures of matplotlib have. */
  home() {
    const [azimuth, elevation] = this.data.look.eye;
    const [a, e] = [(azimuth * Math.PI) / 180, (elevation * Math.PI) / 180];
    const d = 4 * this.radius;
    const [x, y, z] = this.middle;
    this.controls.target.set(x, y, z);
    this.camera.position.set(x + d * Math.cos(e) * Math.cos(a), y + d * Math.cos(e) * Math.sin(a), z + d * Math.sin(e));
    this.camera.zoom = 1;
    this.camera.updateProjectionMatrix();
    this.controls.update();
  }

  /** Wheel zooms only with Ctrl or Shift, so that the page scrolls. */
  #wheel() {
    this.canvas.addEventListener("wheel", (/** @type {WheelEvent} */ event) => {
      if (!event.ctrlKey && !event.shiftKey) event.stopImmediatePropagation();
    }, { capture: true });
  }

  /** @param {KeyboardEvent} event */
  #key(event) {
    const step = 0.1;
    const arm = this.camera.position.clone().sub(this.controls.target);
    if (event.key === "ArrowLeft" || event.key === "ArrowRight") {
      arm.applyAxisAngle(new THREE.Vector3(0, 0, 1), event.key === "ArrowLeft" ? -step : step);
    } else if (event.key === "ArrowUp" || event.key === "ArrowDown") {
      const side = new THREE.Vector3().crossVectors(arm, new THREE.Vector3(0, 0, 1)).normalize();
      const turned = arm.clone().applyAxisAngle(side, event.key === "ArrowUp" ? step : -step);
      if (Math.abs(turned.z) < 0.995 * turned.length()) arm.copy(turned);
    } else if (event.key === "+" || event.key === "=") this.camera.zoom *= 1.2;
    else if (event.key === "-") this.camera.zoom /= 1.2;
    else if (event.key === "0") {
      this.home();
      this.render();
      return;
    } else return;
    event.preventDefault();
    this.camera.position.copy(this.controls.target).add(arm);
    this.camera.updateProjectionMatrix();
    this.controls.update();
    this.render();
  }

  #controlPanel() {
    /** @param {string} name @param {number} min @param {number} max @param {number} value @param {(v: number) => void} use */
    const slider = (name, min, max, value, use) => el("label", {}, name, el("input", {
      type: "range", min, max, step: 0.01, value, "aria-label": name,
      oninput: (/** @type {any} */ event) => { use(Number(event.target.value)); this.move(this.share); },
    }));
    const axis = el("select", { "aria-label": "Cut across", onchange: (/** @type {any} */ event) => {
      this.cut.axis = Number(event.target.value);
      this.#clip();
    } }, ["no cut", "cut x", "cut y", "cut z"].map((name, k) => el("option", { value: k - 1 }, name)));
    this.controlsRow.replaceChildren(
      slider("explode", 0, 1, 0, (v) => { this.explode = v; }),
      slider("see through", 0, 0.9, 0, (v) => { this.opacity = 1 - v; this.#fade(); }),
      el("span", { class: "cut" }, axis, slider("place of the cut", 0, 1, 1, (v) => { this.cut.share = v; this.#clip(); })),
      el("button", { type: "button", onclick: () => { this.home(); this.render(); } }, "reset view"),
    );
  }

  /** @param {Drawing} what */
  draw(what) {
    this.what = what;
    const { look, structure } = this.data;
    const { labelling, view, solved } = what;
    this.#clear();
    const colours = coloursOf(structure, labelling, look.tints.length);
    this.blocks = blocksOf(structure, labelling);
    const gone = goneOf(structure, labelling);
    this.groups = structure.elements.map(() => {
      const group = new THREE.Group();
      group.matrixAutoUpdate = false;
      this.scene.add(group);
      return group;
    });
    this.solids = structure.elements.map((element, k) => {
      const fill = element.support ? look.support : view === "forces" ? look.plain : look.tints[colours[k]];
      const paint = this.#keep(`solid ${fill}`, () => new THREE.MeshLambertMaterial({ color: fill, side: THREE.DoubleSide, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 }));
      const mesh = new THREE.Mesh(this.#keep(`element ${k}`, () => solid(element)), paint);
      mesh.userData = { element: k };
      this.groups?.[k].add(mesh);
      const edges = this.#keep(`edges ${k}`, () => segments(ringSegments(element.faces.map((ring) => ring.map((v) => element.shape[v])))));
      this.groups?.[k].add(this.#lines(edges, look.soft, 0.9));
      mesh.visible = !gone.has(k);
      if (gone.has(k) && this.groups) this.groups[k].visible = false;
      return mesh;
    });
    this.faces = structure.faces.map((face, k) => {
      const dry = labelling[k] === "d";
      const used = view === "forces" && solved?.utilisation ? solved.utilisation[k] : null;
      const colour = used !== null ? ramp(look.used, used) : dry ? look.ink : look.soft;
      const opacity = used !== null ? 0.45 : dry ? 0.16 : 0.05;
      const glaze = this.#keep(`sheet ${colour} ${opacity}`, () => new THREE.MeshBasicMaterial({ color: colour, transparent: true, opacity, side: THREE.DoubleSide, depthWrite: false }));
      const patch = new THREE.Mesh(this.#keep(`face ${k}`, () => sheet(face.polygon)), glaze);
      patch.userData = { face: k };
      const width = used !== null ? 1.5 + 2.5 * used : dry ? 2.6 : 1.4;
      const ring = this.#keep(`rim ${k}`, () => segments(ringSegments([face.polygon])));
      const sides = view === "mechanism" && solved?.mechanism ? face.elements : [face.elements[1]];
      for (const side of labelling[k] === "v" ? [] : sides) {
        this.groups?.[side].add(this.#lines(ring, colour, width, dry ? 0 : 0.06 * structure.typical));
      }
      if (what.marked.has(k)) this.groups?.[face.elements[1]].add(this.#lines(ring, "#c2185b", 6));
      if (what.current === k) this.groups?.[face.elements[1]].add(this.#lines(ring, "#0b66c3", 5));
      patch.visible = labelling[k] !== "v";
      this.groups?.[face.elements[1]].add(patch);
      return patch;
    });
    for (const member of structure.members) {
      const pairs = member.points.slice(1).flatMap((point, k) => [...member.points[k], ...point]);
      this.#free(this.#lines(this.#keep(`member ${member.name}`, () => segments(pairs)), look.member, 4));
    }
    if (view === "forces" && solved?.forces) this.#forces(solved);
    if (view !== "mechanism") this.#loads(what.loads);
    if (view === "mechanism" && solved?.mechanism) {
      this.#places(solved);
      const rings = structure.elements.filter((e, k) => !e.support && !gone.has(k)).flatMap((e) => e.faces.map((ring) => ring.map((v) => e.shape[v])));
      this.#free(this.#lines(this.#keep("rest", () => segments(ringSegments(rings))), look.rest, 0.8));
    }
    this.#clip(false);
    this.#fade(false);
    this.canvas.setAttribute("aria-label", `${this.data.title}: ${view}, spatial view; arrow keys turn it, plus and minus zoom, 0 resets`);
    this.move(this.share);
  }

  /** @param {import("./contract.js").CaseSolution} solved */
  #forces(solved) {
    const { look, structure } = this.data;
    const { vectors, pressure, forces } = solved;
    if (!vectors || !pressure || !forces) return;
    const sizes = vectors.map((v) => Math.hypot(...v));
    const largest = Math.max(1e-300, ...sizes);
    const seen = sizes.filter((s) => s > look.small * largest).sort((a, b) => a - b);
    const longest = Math.min(2, Math.max(0.85, (0.35 * largest) / (seen[seen.length >> 1] ?? 1))) * structure.typical;
    structure.faces.forEach((face, k) => {
      if (sizes[k] <= look.small * largest) return;
      const along = vectors[k].map((v) => (v * longest) / largest);
      const foot = pressure[k].map((x, axis) => x - 0.5 * along[axis]);
      const arrow = this.#arrow(foot, along, look.press, forces[k][0] < 0);
      this.groups?.[face.elements[1]].add(arrow);
    });
  }

  /** @param {import("./contract.js").Load[]} loads */
  #loads(loads) {
    const { look, structure } = this.data;
    const most = Math.max(1e-300, ...loads.filter((l) => l.kind === "live").map((l) => Math.hypot(...l.vector)));
    for (const load of loads) {
      if (load.kind === "couple") {
        const size = Math.hypot(...load.vector) || 1;
        this.#free(this.#arrow(load.at, load.vector.map((v) => (0.1 * structure.size * v) / size), look.load, true));
        continue;
      }
      const size = load.kind === "body" ? Math.hypot(...load.vector) || 1 : most;
      const along = load.vector.map((v) => (0.13 * structure.size * v) / size);
      const tip = load.kind === "body" ? beside(structure, load, 0.04).tip : load.at;
      const arrow = this.#arrow(tip.map((x, k) => x - along[k]), along, look.load, false, load.kind === "body" ? 2 : 1.2);
      const element = structure.elements.findIndex((e) => e.id === load.element);
      arrow.traverse((/** @type {any} */ part) => { part.userData = { load: this.data.loads.indexOf(load) }; });
      if (element >= 0) this.groups?.[element].add(arrow);
      else this.#free(arrow);
    }
  }

  /** @param {import("./contract.js").CaseSolution} solved */
  #places(solved) {
    const { look, structure } = this.data;
    const r = 0.06 * structure.typical;
    /** @type {Record<string, () => any>} */
    const shapes = { circle: () => new THREE.SphereGeometry(r, 12, 8), diamond: () => new THREE.OctahedronGeometry(r), triangle: () => new THREE.TetrahedronGeometry(1.2 * r), cross: () => new THREE.BoxGeometry(1.3 * r, 1.3 * r, 1.3 * r) };
    (solved.movements ?? []).forEach((kind, k) => {
      const mark = look.movements[kind];
      if (!mark || !solved.places) return;
      const node = new THREE.Mesh((shapes[mark.shape] ?? shapes.circle)(), new THREE.MeshLambertMaterial({ color: mark.fill }));
      const [x, y, z] = solved.places[k];
      node.position.set(x, y, z);
      node.userData = { face: k };
      this.groups?.[structure.faces[k].elements[1]].add(node);
    });
  }

  /**
   * @param {number[]} foot @param {number[]} along @param {string} colour @param {boolean} hollow @param {number} [stout]
   */
  #arrow(foot, along, colour, hollow, stout = 1) {
    const length = Math.hypot(...along) || 1e-9;
    const width = 0.022 * this.data.structure.typical * stout;
    const head = Math.min(6 * width, 0.6 * length);
    const material = new THREE.MeshBasicMaterial({ color: colour, wireframe: hollow });
    const shaft = new THREE.Mesh(new THREE.CylinderGeometry(width, width, length - head, 10), material);
    shaft.position.y = 0.5 * (length - head);
    const cone = new THREE.Mesh(new THREE.ConeGeometry(2.6 * width, head, 14), material);
    cone.position.y = length - 0.5 * head;
    const group = new THREE.Group();
    group.add(shaft, cone);
    group.position.set(foot[0], foot[1], foot[2]);
    const [x, y, z] = along;
    group.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), new THREE.Vector3(x, y, z).normalize());
    return group;
  }

  /** The same thing for the same name, made when it is first asked for. @param {string} name @param {() => any} make */
  #keep(name, make) {
    if (!this.kept.has(name)) {
      const made = make();
      made.isKept = true;
      this.kept.set(name, made);
    }
    return this.kept.get(name);
  }

  /** @param {any} node */
  #free(node) {
    const group = new THREE.Group();
    group.add(node);
    this.scene.add(group);
    this.loose = [...(this.loose ?? []), group];
  }

  /**
   * @param {any} geometry @param {string} colour @param {number} width px @param {number} [dash] scene units
   */
  #lines(geometry, colour, width, dash = 0) {
    const material = this.#keep(`line ${colour} ${width} ${dash}`, () => new THREE.LineMaterial({ color: colour, linewidth: width, dashed: dash > 0, dashSize: dash || 1, gapSize: dash || 1, polygonOffset: true, polygonOffsetFactor: -2, polygonOffsetUnits: -2 }));
    const lines = new THREE.LineSegments2(geometry, material);
    if (dash > 0) lines.computeLineDistances();
    lines.raycast = () => {};
    return lines;
  }

  /** Displace the elements, and pull the blocks apart. @param {number} share 0 … 1 */
  move(share) {
    this.share = share;
    const { structure } = this.data;
    const solved = this.what?.view === "mechanism" ? this.what.solved : null;
    if (!this.groups || !this.blocks) return;
    const middles = blockMiddles(structure, this.blocks);
    structure.elements.forEach((element, k) => {
      const away = middles[this.blocks?.[k] ?? 0].map((x, axis) => 0.8 * this.explode * (x - this.middle[axis]));
      let [tx, ty, tz, sx, sy, sz] = [...away, 0, 0, 0];
      if (solved?.mechanism) {
        const s = solved.scale * share;
        const [ux, uy, uz, wx, wy, wz] = solved.mechanism[k].map((v) => s * v);
        const [cx, cy, cz] = element.centroid;
        [sx, sy, sz] = [wx, wy, wz];
        tx += ux - (wy * cz - wz * cy);
        ty += uy - (wz * cx - wx * cz);
        tz += uz - (wx * cy - wy * cx);
      }
      // linear in the velocities: x + u + ω × (x − c)
      this.groups?.[k].matrix.set(1, -sz, sy, tx, sz, 1, -sx, ty, -sy, sx, 1, tz, 0, 0, 0, 1);
      this.groups?.[k].updateMatrixWorld(true);
    });
    this.render();
  }

  #fade(now = true) {
    for (const mesh of this.solids ?? []) {
      const glass = this.opacity < 1 || this.what?.view === "forces";
      if (mesh.material.transparent !== glass) mesh.material.needsUpdate = true;
      mesh.material.transparent = glass;
      mesh.material.opacity = this.what?.view === "forces" ? Math.min(this.opacity, 0.45) : this.opacity;
      mesh.material.depthWrite = !glass;
    }
    if (now) this.render();
  }

  #clip(now = true) {
    const { axis, share } = this.cut;
    const planes = axis < 0 ? [] : [new THREE.Plane(new THREE.Vector3(...[0, 1, 2].map((k) => (k === axis ? -1 : 0))), this.low[axis] + share * (this.high[axis] - this.low[axis]))];
    for (const group of [...(this.groups ?? []), ...(this.loose ?? [])]) {
      group.traverse((/** @type {any} */ part) => { if (part.material) part.material.clippingPlanes = planes; });
    }
    if (now) this.render();
  }

  #clear() {
    for (const group of [...(this.groups ?? []), ...(this.loose ?? [])]) {
      this.scene.remove(group);
      group.traverse((/** @type {any} */ part) => {
        if (!part.geometry?.isKept) part.geometry?.dispose();
        if (!part.material?.isKept) part.material?.dispose();
      });
    }
    /** @type {any[]} */
    this.loose = [];
  }

  /**
   * What lies under the pointer: the nearest face where one is close, else the element.
   * @param {PointerEvent | MouseEvent} event
   * @returns {{face?: number, element?: number, load?: number} | null}
   */
  pick(event) {
    const box = this.canvas.getBoundingClientRect();
    const at = new THREE.Vector2(((event.clientX - box.left) / box.width) * 2 - 1, 1 - ((event.clientY - box.top) / box.height) * 2);
    const ray = new THREE.Raycaster();
    ray.setFromCamera(at, this.camera);
    const hits = ray.intersectObjects([...(this.groups ?? []), ...(this.loose ?? [])], true).filter((/** @type {any} */ hit) => Object.keys(hit.object.userData).length);
    if (!hits.length) return null;
    const first = hits.find((/** @type {any} */ hit) => hit.object.userData.load !== undefined || hit.object.userData.element !== undefined) ?? hits[0];
    const near = hits.find((/** @type {any} */ hit) => hit.object.userData.face !== undefined && (this.opacity < 0.95 || hit.distance <= first.distance + 0.02 * this.size));
    return near ? near.object.userData : first.object.userData;
  }

  #resize() {
    const wide = this.canvas.clientWidth || 640;
    const high = this.canvas.clientHeight || Math.round(0.66 * wide);
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
    this.renderer.setSize(wide, high, false);
    const half = 1.12 * this.radius;
    const aspect = wide / high;
    const [x, y] = aspect > 1 ? [half * aspect, half] : [half, half / aspect];
    Object.assign(this.camera, { left: -x, right: x, top: y, bottom: -y });
    this.camera.updateProjectionMatrix();
    this.renderNow();
  }

  /** Draw with the next frame, however often it is asked for until then. */
  render() {
    this.frame ??= requestAnimationFrame(() => this.renderNow());
  }

  renderNow() {
    if (this.frame) cancelAnimationFrame(this.frame);
    this.frame = undefined;
    this.renderer.render(this.scene, this.camera);
  }

  /** A picture of what is shown, as the address of a PNG. */
  picture() {
    this.renderNow();
    return this.canvas.toDataURL("image/png");
  }

  /** The picture as a file. */
  takeaway() {
    const bytes = Uint8Array.from(atob(this.picture().split(",")[1]), (character) => character.charCodeAt(0));
    return { name: "layout.png", kind: "image/png", content: bytes };
  }

  dispose() {
    this.watch.disconnect();
    if (this.frame) cancelAnimationFrame(this.frame);
    this.#clear();
    for (const thing of this.kept.values()) thing.dispose();
    this.controls.dispose();
    this.renderer.dispose();
    this.renderer.forceContextLoss();
    this.canvas.remove();
  }
}

/** @param {import("./contract.js").Structure} structure @param {number[]} blocks */
function blockMiddles(structure, blocks) {
  /** @type {number[][]} */
  const sums = [];
  structure.elements.forEach((element, k) => {
    const sum = (sums[blocks[k]] ??= [0, 0, 0, 0]);
    element.centroid.forEach((x, axis) => { sum[axis] += x; });
    sum[3] += 1;
  });
  return sums.map(([x, y, z, n]) => [x / n, y / n, z / n]);
}

/** @param {import("./contract.js").Element} element */
function solid(element) {
  const triangles = element.faces.flatMap((ring) => fan(ring.map((v) => element.shape[v])));
  return geometry(triangles);
}

/** @param {number[][]} ring */
function sheet(ring) {
  return geometry(fan(ring));
}

/** Line segments of any width. @param {number[]} positions */
function segments(positions) {
  const made = new THREE.LineSegmentsGeometry();
  made.setPositions(positions);
  return made;
}

/** @param {number[][][]} triangles */
function geometry(triangles) {
  const made = new THREE.BufferGeometry();
  made.setAttribute("position", new THREE.Float32BufferAttribute(triangles.flat(2), 3));
  made.computeVertexNormals();
  return made;
}

/** Triangles of a plane ring, which need not be convex. @param {number[][]} ring */
function fan(ring) {
  if (ring.length === 3) return [ring];
  const normal = [0, 0, 0];
  ring.forEach((p, k) => {
    const q = ring[(k + 1) % ring.length];
    normal[0] += (p[1] - q[1]) * (p[2] + q[2]);
    normal[1] += (p[2] - q[2]) * (p[0] + q[0]);
    normal[2] += (p[0] - q[0]) * (p[1] + q[1]);
  });
  const drop = normal.map(Math.abs).indexOf(Math.max(...normal.map(Math.abs)));
  const keep = [[1, 2], [2, 0], [0, 1]][drop];
  const flat = ring.map((p) => new THREE.Vector2(p[keep[0]], p[keep[1]]));
  const turned = normal[drop] < 0;
  return THREE.ShapeUtils.triangulateShape(flat, []).map((/** @type {number[]} */ [a, b, c]) => (turned ? [ring[a], ring[c], ring[b]] : [ring[a], ring[b], ring[c]]).map((p) => p));
}

/** @param {number[][][]} rings */
function ringSegments(rings) {
  return rings.flatMap((ring) => ring.flatMap((p, k) => [...p, ...ring[(k + 1) % ring.length]]));
}
