// @ts-check
import { add, identity, matrixOf, multiply, rotation, times, translation } from "./mathx.js";

/**
 * Forward kinematics over the links of a run's header.
 *
 * Takes the configuration of the whole robot in the order of `q_names`; gives the pose of each link in the base frame as a
 * 4x4 matrix, in the order of `links`. Parents come before children.
 */
export class Kinematics {
  /** @param {any} header the `/run` message */
  constructor(header) {
    this.links = (header.links ?? []).map((/** @type {any} */ link) => ({
      name: link.name,
      parent: link.parent,
      origin: matrixOf(link.joint?.origin),
      kind: link.joint?.kind ?? "fixed",
      axis: link.joint?.axis ?? [0, 0, 1],
      source: link.joint?.source ?? null,
    }));
    /** @type {Map<string, number>} */
    this.byName = new Map(this.links.map((/** @type {any} */ link, /** @type {number} */ idx) => [link.name, idx]));
  }

  /** @param {ArrayLike<number>} q @param {any} link @returns {number[]} the link in its parent */
  #local(q, link) {
    const source = link.source;
    if (!source || link.kind === "fixed") return link.origin;
    const value = (source.multiplier ?? 1) * (q[source.q] ?? 0) + (source.offset ?? 0);
    const motion = link.kind === "prismatic" ? translation(times(link.axis, value)) : rotation(link.axis, value);
    return multiply(link.origin, motion);
  }

  /** @param {ArrayLike<number>} q @returns {number[][]} */
  poses(q) {
    /** @type {number[][]} */
    const poses = [];
    for (const link of this.links) {
      const parent = link.parent === null || link.parent === undefined ? identity() : poses[link.parent];
      poses.push(multiply(parent, this.#local(q, link)));
    }
    return poses;
  }

  /** The pose of one link alone. @param {ArrayLike<number>} q @param {string} name @returns {number[] | null} */
  pose(q, name) {
    let idx = this.byName.get(name);
    if (idx === undefined) return null;
    let pose = identity();
    while (idx !== null && idx !== undefined) {
      /** @type {any} */
      const link = this.links[idx];
      pose = multiply(this.#local(q, link), pose);
      idx = link.parent;
    }
    return pose;
  }

  /** Where the origin of a link is. @param {ArrayLike<number>} q @param {string} name */
  position(q, name) {
    const pose = this.pose(q, name);
    return pose ? add([0, 0, 0], pose.slice(12, 15)) : null;
  }
}
