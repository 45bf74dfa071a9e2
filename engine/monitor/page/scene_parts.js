// @ts-check
/** What stands in the scene, as meshes: links, things, table, grains, and the glyph of a palm pose. */
import { matrixOf, multiply, rotation, scaling, translation } from "./mathx.js";
import { colourOf, GRAIN, TABLE, TOUCH } from "./palette.js";
import * as shapes from "./shapes.js";

/** @typedef {import("./gl.js").Renderer} Renderer */
/** @typedef {import("./gl.js").Item} Item */
/** @typedef {import("./gl.js").Mesh} Mesh */

/** @param {any} shape of the header @returns {shapes.Geometry | null} */
function geometryOf(shape) {
  const [a, b] = shape.size ?? [];
  switch (shape.kind) {
    case "box": return shapes.box(shape.size);
    case "cylinder": return shapes.cylinder(a, b);
    case "sphere": return shapes.sphere(a);
    case "capsule": return shapes.capsule(a, b);
    // Meshes of links are attachments for other viewers; the page draws what collides.
    default: return null;
  }
}

/**
 * The links of a robot.
 * @param {Renderer} renderer
 * @param {any} header
 * @returns {{link: number, item: Item, own: number[]}[]}
 */
export function linkParts(renderer, header) {
  const parts = [];
  for (const [link, { shapes: list }] of (header.links ?? []).entries()) {
    for (const shape of list ?? []) {
      const geometry = geometryOf(shape);
      if (!geometry) continue;
      const own = matrixOf(shape.origin);
      const colour = colourOf(shape.colour, [0.8, 0.81, 0.83]);
      parts.push({ link, own, item: { mesh: renderer.mesh(geometry), model: own, colour, gloss: 0.45 } });
    }
  }
  return parts;
}

/**
 * The things of a simulated scene.
 * @param {Renderer} renderer
 * @param {any} header
 * @returns {{object: number, item: Item}[]}
 */
export function objectParts(renderer, header) {
  const parts = [];
  for (const [object, { meshes }] of (header.objects ?? []).entries()) {
    for (const piece of meshes ?? []) {
      const vertices = new Float32Array(shapes.bytesOf(piece.vertices));
      const triangles = new Uint32Array(shapes.bytesOf(piece.triangles));
      const item = {
        mesh: renderer.mesh(shapes.mesh(vertices, triangles)), model: translation([0, 0, 0]),
        colour: colourOf(piece.colour, [0.6, 0.6, 0.65]), gloss: 0.5,
      };
      parts.push({ object, item });
    }
  }
  return parts;
}

/** A table top on four legs. @param {Renderer} renderer @param {{height_m: number, low: number[], high: number[]}} table @returns {Item[]} */
export function tableParts(renderer, { height_m: height, low, high }) {
  const thick = Math.min(0.035, 0.5 * height);
  const [width, depth] = [high[0] - low[0], high[1] - low[1]];
  const middle = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2];
  const top = {
    mesh: renderer.mesh(shapes.box([width, depth, thick], 0.006)),
    model: translation([...middle, height - thick / 2]), colour: TABLE, gloss: 0.12,
  };
  const inset = 0.06;
  const leg = renderer.mesh(shapes.cylinder(0.022, height - thick));
  const legs = [[low[0] + inset, low[1] + inset], [high[0] - inset, low[1] + inset], [low[0] + inset, high[1] - inset], [high[0] - inset, high[1] - inset]]
    .map((at) => ({ mesh: leg, model: translation([...at, (height - thick) / 2]), colour: TABLE.map((x) => 0.72 * x), gloss: 0.1 }));
  return [top, ...legs];
}

const COLOURS = /** @type {Record<string, number[]>} */ ({
  black: [0.15, 0.15, 0.16], grey: [0.55, 0.56, 0.58], white: [0.93, 0.93, 0.92], red: [0.8, 0.2, 0.18], orange: [0.93, 0.55, 0.18],
  yellow: [0.93, 0.8, 0.25], green: [0.28, 0.62, 0.32], blue: [0.22, 0.42, 0.8], purple: [0.5, 0.32, 0.68], pink: [0.93, 0.6, 0.7],
  brown: [0.5, 0.35, 0.22],
});

/** Where there is no truth: what the robot has seen, as plain translucent bodies. @param {Renderer} renderer @param {any} inventory @returns {Item[]} */
export function clusterParts(renderer, inventory) {
  return (inventory?.clusters ?? []).map((/** @type {any} */ cluster) => {
    const [long, short, tall] = cluster.size_m;
    const isRound = ["upright_cylinder", "upright_oval", "wide_round"].includes(cluster.shape);
    const isBall = cluster.shape === "blob";
    const model = multiply(
      multiply(translation(cluster.centre_in_base), rotation([0, 0, 1], cluster.yaw_rad)),
      isRound || isBall ? scaling([long, short, tall]) : scaling([1, 1, 1]),
    );
    const shape = isRound ? shapes.cylinder(0.5, 1) : isBall ? shapes.sphere(0.5) : shapes.box([long, short, tall]);
    const mesh = renderer.mesh(shape);
    return { mesh, model, colour: COLOURS[cluster.colour] ?? COLOURS.grey, alpha: 0.55, gloss: 0.3 };
  });
}

/** @param {Renderer} renderer @returns {Item} many small balls, placed by centre and radius */
export function grainPart(renderer) {
  return { mesh: renderer.mesh(shapes.sphere(1, 12), true), model: translation([0, 0, 0]), colour: GRAIN, gloss: 0.6, glow: 0.15 };
}

/** @param {Renderer} renderer @returns {Item} balls where something is touched, seen through what is before them */
export function contactPart(renderer) {
  return { ...grainPart(renderer), colour: TOUCH, glow: 0.8, castsShadow: false, shinesThrough: true };
}

/** Balls at the contacts, larger where more presses; what merely stands on the table is left out. @param {any[]} contacts */
export function contactPlaces(contacts) {
  const radius = (/** @type {number} */ impulse) => 0.003 + 0.004 * Math.min(1, impulse / 0.08);
  const touches = contacts.filter((contact) => contact.point_in_base && contact.with !== "table");
  return Float32Array.from(touches.flatMap(({ point_in_base: p, impulse_ns: impulse }) => [p[0], p[1], p[2], radius(impulse)]));
}

/**
 * A small hand: the palm, four fingers along +X bent towards +Z (the way it approaches), the thumb at +Y (left) or -Y (right),
 * and a stem behind it along -Z.
 * @param {Renderer} renderer
 * @param {"left" | "right"} side
 */
export function palmGlyph(renderer, side) {
  const mirror = side === "right" ? -1 : 1;
  const bar = (/** @type {number[]} */ a, /** @type {number[]} */ b, /** @type {number} */ radius) =>
    ({ geometry: shapes.tube([a, b], radius), matrix: translation([0, 0, 0]) });
  const knob = (/** @type {number[]} */ at, /** @type {number} */ radius) =>
    ({ geometry: shapes.sphere(radius, 12), matrix: translation(at) });
  const parts = [{ geometry: shapes.box([0.042, 0.04, 0.008], 0.004), matrix: translation([-0.004, 0, -0.004]) }];
  for (const y of [-0.0165, -0.0055, 0.0055, 0.0165]) {
    const [root, middle, tip] = [[0.016, y, -0.004], [0.034, y, 0], [0.044, y, 0.013]];
    parts.push(bar(root, middle, 0.004), knob(middle, 0.004), bar(middle, tip, 0.004), knob(tip, 0.004));
  }
  const thumb = [[-0.006, 0.018 * mirror, -0.003], [0.006, 0.034 * mirror, 0.006], [0.016, 0.036 * mirror, 0.017]];
  parts.push(bar(thumb[0], thumb[1], 0.0045), knob(thumb[1], 0.0045), bar(thumb[1], thumb[2], 0.0045), knob(thumb[2], 0.0045));
  parts.push(bar([-0.004, 0, -0.006], [-0.004, 0, -0.05], 0.0024), knob([-0.004, 0, -0.05], 0.0045));
  return renderer.mesh(shapes.merge(parts));
}
