// @ts-check
/** Small linear algebra: column-major 4x4 matrices as plain arrays of 16 numbers, points as arrays of 3. */

/** @typedef {number[]} Mat4 */
/** @typedef {{rotation: number[], translation: number[]}} Pose rotation as [x, y, z, w], translation in metres */

/** @returns {number[]} */
export function identity() {
  return [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
}

/**
 * `a * b`.
 * @param {Mat4} a
 * @param {Mat4} b
 * @returns {number[]}
 */
export function multiply(a, b) {
  const out = new Array(16);
  for (let column = 0; column < 4; column += 1) {
    for (let row = 0; row < 4; row += 1) {
      let sum = 0;
      for (let k = 0; k < 4; k += 1) sum += a[k * 4 + row] * b[column * 4 + k];
      out[column * 4 + row] = sum;
    }
  }
  return out;
}

/**
 * The matrix of a pose.
 * @param {Pose | null | undefined} pose
 * @returns {number[]}
 */
export function matrixOf(pose) {
  if (!pose) return identity();
  const [x, y, z, w] = pose.rotation;
  const [tx, ty, tz] = pose.translation;
  return [
    1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w), 0,
    2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w), 0,
    2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y), 0,
    tx, ty, tz, 1,
  ];
}

/** @param {number[]} p @returns {number[]} */
export function translation(p) {
  return [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, p[0], p[1], p[2], 1];
}

/** @param {number[]} s @returns {number[]} */
export function scaling(s) {
  return [s[0], 0, 0, 0, 0, s[1], 0, 0, 0, 0, s[2], 0, 0, 0, 0, 1];
}

/**
 * Rotation about a unit axis.
 * @param {number[]} axis
 * @param {number} angle radians
 * @returns {number[]}
 */
export function rotation(axis, angle) {
  const half = angle / 2;
  const s = Math.sin(half);
  return matrixOf({ rotation: [axis[0] * s, axis[1] * s, axis[2] * s, Math.cos(half)], translation: [0, 0, 0] });
}

/** @param {Mat4} m @param {number[]} p @returns {number[]} the point `p` moved by `m` */
export function transform(m, p) {
  return [0, 1, 2].map((row) => m[row] * p[0] + m[4 + row] * p[1] + m[8 + row] * p[2] + m[12 + row]);
}

/** @param {number[]} a @param {number[]} b @returns {number[]} */
export function subtract(a, b) {
  return [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
}

/** @param {number[]} a @param {number[]} b @returns {number[]} */
export function add(a, b) {
  return [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
}

/** @param {number[]} a @param {number} k @returns {number[]} */
export function times(a, k) {
  return [a[0] * k, a[1] * k, a[2] * k];
}

/** @param {number[]} a @param {number[]} b @returns {number[]} */
export function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

/** @param {number[]} a @param {number[]} b */
export function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/** @param {number[]} a @returns {number} */
export function length(a) {
  return Math.hypot(a[0], a[1], a[2]);
}

/** @param {number[]} a @returns {number[]} */
export function normalize(a) {
  const n = length(a);
  return n > 1e-12 ? times(a, 1 / n) : [0, 0, 1];
}

/**
 * World to camera: the camera looks along its -Z, +Y is up.
 * @param {number[]} eye
 * @param {number[]} target
 * @param {number[]} up
 * @returns {number[]}
 */
export function lookAt(eye, target, up) {
  const back = normalize(subtract(eye, target));
  const right = normalize(cross(up, back));
  const above = cross(back, right);
  return [
    right[0], above[0], back[0], 0, right[1], above[1], back[1], 0, right[2], above[2], back[2], 0,
    -dot(right, eye), -dot(above, eye), -dot(back, eye), 1,
  ];
}

/**
 * @param {number} fovY radians
 * @param {number} aspect width / height
 * @param {number} near
 * @param {number} far
 * @returns {number[]}
 */
export function perspective(fovY, aspect, near, far) {
  const f = 1 / Math.tan(fovY / 2);
  return [f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0];
}

/**
 * A box of space `half` metres to each side and `depth` metres deep.
 * @param {number} half
 * @param {number} depth
 * @returns {number[]}
 */
export function orthographic(half, depth) {
  return [1 / half, 0, 0, 0, 0, 1 / half, 0, 0, 0, 0, -2 / depth, 0, 0, 0, -1, 1];
}
