// @ts-check
/** Triangle geometry of the shapes that links and things are made of. Metres; cylinders and capsules lie along Z. */

/** @typedef {{positions: Float32Array, normals: Float32Array, indices: Uint32Array}} Geometry */

/** Rings of a round shape: fine enough to look smooth at the size of a hand. */
const AROUND = 28;

class Builder {
  constructor() {
    /** @type {number[]} */ this.positions = [];
    /** @type {number[]} */ this.normals = [];
    /** @type {number[]} */ this.indices = [];
  }

  /** @param {number[]} p @param {number[]} n @returns {number} */
  vertex(p, n) {
    this.positions.push(p[0], p[1], p[2]);
    this.normals.push(n[0], n[1], n[2]);
    return this.positions.length / 3 - 1;
  }

  /** A grid of vertices `rows x columns`, joined by triangles. @param {number} rows @param {number} columns @param {(r: number, c: number) => [number[], number[]]} at */
  grid(rows, columns, at) {
    const first = this.positions.length / 3;
    for (let r = 0; r < rows; r += 1) {
      for (let c = 0; c < columns; c += 1) this.vertex(...at(r, c));
    }
    for (let r = 0; r + 1 < rows; r += 1) {
      for (let c = 0; c + 1 < columns; c += 1) {
        const a = first + r * columns + c;
        this.indices.push(a, a + 1, a + columns, a + 1, a + columns + 1, a + columns);
      }
    }
  }

  /** @returns {Geometry} */
  done() {
    return {
      positions: new Float32Array(this.positions),
      normals: new Float32Array(this.normals),
      indices: new Uint32Array(this.indices),
    };
  }
}

/**
 * A box with softly rounded edges, so that light shows where they are.
 * @param {number[]} size full extents
 * @param {number} [bevel] radius of the edges
 * @returns {Geometry}
 */
export function box(size, bevel = Math.min(0.01, 0.18 * Math.min(...size))) {
  const builder = new Builder();
  const steps = 4;
  const half = size.map((edge) => Math.max(edge / 2 - bevel, 0));
  // Each of the six faces is a grid on a cube, pushed onto a sphere of the bevel's radius at the nearest corner.
  for (let axis = 0; axis < 3; axis += 1) {
    for (const sign of [1, -1]) {
      const n = 2 * steps;
      builder.grid(n, n, (r, c) => {
        const u = edge(r, steps);
        const v = edge(sign > 0 ? c : n - 1 - c, steps);
        const cube = [0, 0, 0];
        cube[axis] = sign;
        cube[(axis + 1) % 3] = v.at;
        cube[(axis + 2) % 3] = u.at;
        const norm = Math.hypot(...cube);
        const normal = cube.map((x) => x / norm);
        const corner = [0, 0, 0];
        corner[axis] = sign * half[axis];
        corner[(axis + 1) % 3] = v.side * half[(axis + 1) % 3];
        corner[(axis + 2) % 3] = u.side * half[(axis + 2) % 3];
        return [corner.map((x, i) => x + normal[i] * bevel), normal];
      });
    }
  }
  flipInward(builder);
  return builder.done();
}

/** Place of a grid line on a face: the first half of the lines belongs to the lower corner. @param {number} k @param {number} steps */
function edge(k, steps) {
  const side = k < steps ? -1 : 1;
  const along = k < steps ? k / (steps - 1) : (k - steps) / (steps - 1);
  return { side, at: side < 0 ? -1 + along : along };
}

/** Turns triangles whose winding disagrees with their normals. @param {Builder} builder */
function flipInward(builder) {
  const { positions: p, normals: n, indices } = builder;
  for (let i = 0; i < indices.length; i += 3) {
    const [a, b, c] = [indices[i] * 3, indices[i + 1] * 3, indices[i + 2] * 3];
    const u = [p[b] - p[a], p[b + 1] - p[a + 1], p[b + 2] - p[a + 2]];
    const v = [p[c] - p[a], p[c + 1] - p[a + 1], p[c + 2] - p[a + 2]];
    const face = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    if (face[0] * (n[a] + n[b] + n[c]) + face[1] * (n[a + 1] + n[b + 1] + n[c + 1]) + face[2] * (n[a + 2] + n[b + 2] + n[c + 2]) < 0) {
      [indices[i + 1], indices[i + 2]] = [indices[i + 2], indices[i + 1]];
    }
  }
}

/**
 * The surface that a profile sweeps about Z.
 * @param {{r: number, z: number, nr: number, nz: number}[]} profile radius, height and normal, from below
 * @param {number} [around]
 * @returns {Geometry}
 */
function revolve(profile, around = AROUND) {
  const builder = new Builder();
  builder.grid(profile.length, around + 1, (row, column) => {
    const angle = (2 * Math.PI * column) / around;
    const { r, z, nr, nz } = profile[row];
    const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
    return [[r * cos, r * sin, z], [nr * cos, nr * sin, nz]];
  });
  return builder.done();
}

/** @param {number} radius @param {number} length @param {number} [around] @returns {Geometry} */
export function cylinder(radius, length, around = AROUND) {
  const bevel = Math.min(0.006, 0.2 * radius, 0.2 * length);
  const profile = [{ r: 0, z: -length / 2, nr: 0, nz: -1 }];
  const corner = (/** @type {number} */ sign) => {
    const points = [];
    for (let k = 0; k <= 4; k += 1) {
      const angle = ((sign < 0 ? k - 4 : k) / 4) * (Math.PI / 2);
      const [nr, nz] = [Math.cos(angle), Math.sin(angle)];
      points.push({ r: radius - bevel + bevel * nr, z: sign * (length / 2 - bevel) + bevel * nz, nr, nz });
    }
    return points;
  };
  profile.push(...corner(-1), ...corner(1), { r: 0, z: length / 2, nr: 0, nz: 1 });
  return revolve(profile, around);
}

/** @param {number} radius @param {number} [around] @returns {Geometry} */
export function sphere(radius, around = AROUND) {
  return capsule(radius, 0, around);
}

/** @param {number} radius @param {number} length of the straight part @param {number} [around] @returns {Geometry} */
export function capsule(radius, length, around = AROUND) {
  const rings = Math.max(4, around / 4);
  const profile = [];
  for (let k = -rings; k <= rings; k += 1) {
    const angle = (k / rings) * (Math.PI / 2);
    const [nr, nz] = [Math.cos(angle), Math.sin(angle)];
    if (k === 0 && length > 0) profile.push({ r: radius, z: -length / 2, nr: 1, nz: 0 });
    profile.push({ r: radius * nr, z: (k < 0 ? -1 : 1) * (length / 2) + radius * nz, nr, nz });
  }
  return revolve(profile, around);
}

/**
 * A round bar along a chain of points.
 * @param {number[][]} points
 * @param {number} radius
 * @returns {Geometry}
 */
export function tube(points, radius) {
  const builder = new Builder();
  const around = 8;
  const clean = points.filter((p, i) => i === 0 || Math.hypot(...p.map((x, k) => x - points[i - 1][k])) > 1e-4);
  if (clean.length < 2) return builder.done();
  builder.grid(clean.length, around + 1, (row, column) => {
    const before = clean[Math.max(row - 1, 0)];
    const after = clean[Math.min(row + 1, clean.length - 1)];
    const along = unit(after.map((x, i) => x - before[i]));
    const aside = unit(perpendicular(along));
    const third = [
      along[1] * aside[2] - along[2] * aside[1], along[2] * aside[0] - along[0] * aside[2], along[0] * aside[1] - along[1] * aside[0],
    ];
    const angle = (2 * Math.PI * column) / around;
    const normal = aside.map((x, i) => x * Math.cos(angle) + third[i] * Math.sin(angle));
    return [clean[row].map((x, i) => x + radius * normal[i]), normal];
  });
  flipInward(builder);
  return builder.done();
}

/** @param {number[]} a */
function unit(a) {
  const n = Math.hypot(...a) || 1;
  return a.map((x) => x / n);
}

/** @param {number[]} a */
function perpendicular(a) {
  // Paths hardly ever run along this direction, so the bar does not twist.
  const away = Math.abs(a[0]) < 0.9 ? [1, 0.13, 0.07] : [0.13, 1, 0.07];
  return [a[1] * away[2] - a[2] * away[1], a[2] * away[0] - a[0] * away[2], a[0] * away[1] - a[1] * away[0]];
}

/**
 * A mesh from its corners: normals are smooth where faces meet at less than 40 degrees.
 * @param {Float32Array} vertices
 * @param {Uint32Array} triangles
 * @returns {Geometry}
 */
export function mesh(vertices, triangles) {
  const sharp = Math.cos((40 * Math.PI) / 180);
  const n = triangles.length / 3;
  const faces = new Float32Array(n * 3);
  /** @type {Map<string, number[]>} */
  const at = new Map();
  const key = (/** @type {number} */ v) =>
    `${Math.round(vertices[3 * v] * 2e4)},${Math.round(vertices[3 * v + 1] * 2e4)},${Math.round(vertices[3 * v + 2] * 2e4)}`;
  const keys = Array.from({ length: vertices.length / 3 }, (_, v) => key(v));
  for (let f = 0; f < n; f += 1) {
    const [a, b, c] = [0, 1, 2].map((k) => 3 * triangles[3 * f + k]);
    const u = [0, 1, 2].map((k) => vertices[b + k] - vertices[a + k]);
    const v = [0, 1, 2].map((k) => vertices[c + k] - vertices[a + k]);
    // Twice the area is the weight of a face in its corners' normals.
    faces.set([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]], 3 * f);
    for (let k = 0; k < 3; k += 1) {
      const name = keys[triangles[3 * f + k]];
      const list = at.get(name);
      if (list) list.push(f);
      else at.set(name, [f]);
    }
  }
  const positions = new Float32Array(n * 9);
  const normals = new Float32Array(n * 9);
  for (let f = 0; f < n; f += 1) {
    const own = unit([faces[3 * f], faces[3 * f + 1], faces[3 * f + 2]]);
    for (let k = 0; k < 3; k += 1) {
      const v = triangles[3 * f + k];
      const sum = [0, 0, 0];
      for (const other of at.get(keys[v]) ?? []) {
        const face = [faces[3 * other], faces[3 * other + 1], faces[3 * other + 2]];
        const facing = unit(face);
        if (facing[0] * own[0] + facing[1] * own[1] + facing[2] * own[2] >= sharp) {
          for (let i = 0; i < 3; i += 1) sum[i] += face[i];
        }
      }
      positions.set(vertices.subarray(3 * v, 3 * v + 3), 9 * f + 3 * k);
      normals.set(unit(sum), 9 * f + 3 * k);
    }
  }
  return { positions, normals, indices: Uint32Array.from({ length: n * 3 }, (_, i) => i) };
}

/**
 * Several geometries as one.
 * @param {{geometry: Geometry, matrix: number[]}[]} parts
 * @returns {Geometry}
 */
export function merge(parts) {
  const builder = new Builder();
  for (const { geometry: g, matrix: m } of parts) {
    const first = builder.positions.length / 3;
    for (let i = 0; i < g.positions.length; i += 3) {
      const [p, n] = [g.positions.subarray(i, i + 3), g.normals.subarray(i, i + 3)];
      const row = (/** @type {number} */ r, /** @type {ArrayLike<number>} */ x) => m[r] * x[0] + m[4 + r] * x[1] + m[8 + r] * x[2];
      builder.vertex([0, 1, 2].map((r) => row(r, p) + m[12 + r]), [0, 1, 2].map((r) => row(r, n)));
    }
    for (const index of g.indices) builder.indices.push(first + index);
  }
  return builder.done();
}

/** @param {string} text base64 @returns {ArrayBuffer} */
export function bytesOf(text) {
  return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
}
