// @ts-check
import { lookAt, multiply, normalize, orthographic } from "./mathx.js";
import {
  FLOOR_FRAGMENT, FLOOR_VERTEX, SHADOW_FRAGMENT, SHADOW_VERTEX, SOLID_FRAGMENT, SOLID_VERTEX,
} from "./shaders.js";

/** @typedef {import("./shapes.js").Geometry} Geometry */
/** @typedef {{vao: WebGLVertexArrayObject, buffers: WebGLBuffer[], nIndices: number, nInstances: number | null, instances: WebGLBuffer | null}} Mesh */
/** @typedef {{mesh: Mesh, model: number[], colour: number[], alpha?: number, glow?: number, gloss?: number, castsShadow?: boolean, shinesThrough?: boolean}} Item */
/** @typedef {{background: number[], line: number[], sky: number[], ground: number[], shade: number}} Light */

const SHADOW_SIZE = 2048;
const SUN = normalize([0.42, 0.36, 0.84]);

/** Draws items with WebGL2: a shadow map first, then what is solid, the floor, and what is translucent from far to near. */
export class Renderer {
  /** @param {HTMLCanvasElement} canvas */
  constructor(canvas) {
    const gl = canvas.getContext("webgl2", { antialias: true, alpha: false, powerPreference: "low-power" });
    if (!gl) throw new Error("WebGL2 is missing");
    this.gl = gl;
    this.canvas = canvas;
    this.solid = program(gl, SOLID_VERTEX, SOLID_FRAGMENT);
    this.shadow = program(gl, SHADOW_VERTEX, SHADOW_FRAGMENT);
    this.floor = program(gl, FLOOR_VERTEX, FLOOR_FRAGMENT);
    this.map = shadowMap(gl);
    const centre = [0.45, 0, 0.7];
    const eye = centre.map((x, i) => x + 3 * SUN[i]);
    this.lightFromWorld = multiply(orthographic(1.7, 6), lookAt(eye, centre, [0, 0, 1]));
    this.floorMesh = this.mesh({
      positions: new Float32Array([-6, -6, 0, 6, -6, 0, 6, 6, 0, -6, 6, 0]),
      normals: new Float32Array([0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1]),
      indices: new Uint32Array([0, 1, 2, 0, 2, 3]),
    });
  }

  /**
   * Puts a geometry into the graphics memory.
   * @param {Geometry} geometry
   * @param {boolean} [isInstanced] drawn many times, see `place`
   * @returns {Mesh}
   */
  mesh(geometry, isInstanced = false) {
    const { gl } = this;
    const vao = must(gl.createVertexArray());
    gl.bindVertexArray(vao);
    const buffers = [];
    [geometry.positions, geometry.normals].forEach((data, location) => {
      const buffer = must(gl.createBuffer());
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(location);
      gl.vertexAttribPointer(location, 3, gl.FLOAT, false, 0, 0);
      buffers.push(buffer);
    });
    const indices = must(gl.createBuffer());
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, indices);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, geometry.indices, gl.STATIC_DRAW);
    buffers.push(indices);
    let instances = null;
    if (isInstanced) {
      instances = must(gl.createBuffer());
      gl.bindBuffer(gl.ARRAY_BUFFER, instances);
      gl.enableVertexAttribArray(2);
      gl.vertexAttribPointer(2, 4, gl.FLOAT, false, 0, 0);
      gl.vertexAttribDivisor(2, 1);
      buffers.push(instances);
    }
    gl.bindVertexArray(null);
    return { vao, buffers, nIndices: geometry.indices.length, nInstances: isInstanced ? 0 : null, instances };
  }

  /** Says where an instanced mesh is drawn. @param {Mesh} mesh @param {Float32Array} places x, y, z, scale each */
  place(mesh, places) {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, mesh.instances);
    gl.bufferData(gl.ARRAY_BUFFER, places, gl.DYNAMIC_DRAW);
    mesh.nInstances = places.length / 4;
  }

  /** @param {Mesh | null | undefined} mesh */
  free(mesh) {
    if (!mesh) return;
    this.gl.deleteVertexArray(mesh.vao);
    for (const buffer of mesh.buffers) this.gl.deleteBuffer(buffer);
  }

  /**
   * @param {Item[]} items
   * @param {number[]} viewProjection
   * @param {number[]} eye
   * @param {Light} light
   */
  draw(items, viewProjection, eye, light) {
    const { gl } = this;
    gl.enable(gl.DEPTH_TEST);
    gl.depthMask(true);
    this.#drawShadows(items.filter((item) => item.castsShadow !== false && (item.alpha ?? 1) >= 1));
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(light.background[0], light.background[1], light.background[2], 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.disable(gl.BLEND);
    this.#useSolid(viewProjection, eye, light);
    const translucent = [];
    for (const item of items) {
      if ((item.alpha ?? 1) >= 1) this.#drawItem(item);
      else translucent.push(item);
    }
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    this.#drawFloor(viewProjection, eye, light);
    this.#useSolid(viewProjection, eye, light);
    const away = (/** @type {Item} */ item) =>
      Math.hypot(item.model[12] - eye[0], item.model[13] - eye[1], item.model[14] - eye[2]);
    // Back faces first, so that a translucent thing does not cover its own far side in the wrong order.
    gl.enable(gl.CULL_FACE);
    for (const item of translucent.sort((a, b) => away(b) - away(a))) {
      gl.cullFace(gl.BACK);
      this.#drawItem(item);
    }
    // Marks that must not be missed are hinted at where something stands before them.
    gl.cullFace(gl.BACK);
    gl.depthFunc(gl.GREATER);
    for (const item of items.filter((one) => one.shinesThrough)) this.#drawItem({ ...item, alpha: 0.7, glow: 0.4 });
    gl.depthFunc(gl.LESS);
    gl.disable(gl.CULL_FACE);
    gl.depthMask(true);
    gl.bindVertexArray(null);
  }

  /** @param {Item[]} items */
  #drawShadows(items) {
    const { gl, shadow } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.map.framebuffer);
    gl.viewport(0, 0, SHADOW_SIZE, SHADOW_SIZE);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(1.5, 2);
    gl.useProgram(shadow.program);
    gl.uniformMatrix4fv(shadow.at("lightFromWorld"), false, this.lightFromWorld);
    for (const item of items) {
      gl.uniformMatrix4fv(shadow.at("model"), false, item.model);
      this.#submit(item.mesh);
    }
    gl.disable(gl.POLYGON_OFFSET_FILL);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  /** @param {number[]} viewProjection @param {number[]} eye @param {Light} light */
  #useSolid(viewProjection, eye, light) {
    const { gl, solid } = this;
    gl.useProgram(solid.program);
    gl.uniformMatrix4fv(solid.at("viewProjection"), false, viewProjection);
    gl.uniformMatrix4fv(solid.at("lightFromWorld"), false, this.lightFromWorld);
    gl.uniform3fv(solid.at("eye"), eye);
    gl.uniform3fv(solid.at("sun"), SUN);
    gl.uniform3fv(solid.at("sky"), light.sky);
    gl.uniform3fv(solid.at("ground"), light.ground);
    this.#useMap(solid);
  }

  /** @param {{at: (name: string) => WebGLUniformLocation | null}} program */
  #useMap(program) {
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.map.texture);
    gl.uniform1i(program.at("shadowMap"), 0);
  }

  /** @param {Item} item */
  #drawItem(item) {
    const { gl, solid } = this;
    gl.uniformMatrix4fv(solid.at("model"), false, item.model);
    gl.uniform4f(solid.at("colour"), item.colour[0], item.colour[1], item.colour[2], item.alpha ?? 1);
    gl.uniform1f(solid.at("glow"), item.glow ?? 0);
    gl.uniform1f(solid.at("gloss"), item.gloss ?? 0.35);
    this.#submit(item.mesh);
  }

  /** @param {Mesh} mesh */
  #submit(mesh) {
    const { gl } = this;
    gl.bindVertexArray(mesh.vao);
    if (mesh.nInstances === null) {
      gl.vertexAttrib4f(2, 0, 0, 0, 1);
      gl.drawElements(gl.TRIANGLES, mesh.nIndices, gl.UNSIGNED_INT, 0);
    } else if (mesh.nInstances > 0) {
      gl.drawElementsInstanced(gl.TRIANGLES, mesh.nIndices, gl.UNSIGNED_INT, 0, mesh.nInstances);
    }
  }

  /** @param {number[]} viewProjection @param {number[]} eye @param {Light} light */
  #drawFloor(viewProjection, eye, light) {
    const { gl, floor } = this;
    gl.useProgram(floor.program);
    gl.uniformMatrix4fv(floor.at("viewProjection"), false, viewProjection);
    gl.uniformMatrix4fv(floor.at("lightFromWorld"), false, this.lightFromWorld);
    gl.uniform3fv(floor.at("background"), light.background);
    gl.uniform3fv(floor.at("line"), light.line);
    gl.uniform3fv(floor.at("eye"), eye);
    gl.uniform1f(floor.at("shade"), light.shade);
    this.#useMap(floor);
    this.#submit(this.floorMesh);
  }
}

/** @template T @param {T | null} value @returns {T} */
function must(value) {
  if (value === null) throw new Error("the graphics context was lost");
  return value;
}

/** @param {WebGL2RenderingContext} gl @param {string} vertex @param {string} fragment */
function program(gl, vertex, fragment) {
  const handle = must(gl.createProgram());
  for (const [kind, text] of /** @type {[number, string][]} */ ([[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]])) {
    const shader = must(gl.createShader(kind));
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(`shader: ${gl.getShaderInfoLog(shader)}`);
    gl.attachShader(handle, shader);
  }
  gl.linkProgram(handle);
  if (!gl.getProgramParameter(handle, gl.LINK_STATUS)) throw new Error(`shader: ${gl.getProgramInfoLog(handle)}`);
  /** @type {Map<string, WebGLUniformLocation | null>} */
  const places = new Map();
  const at = (/** @type {string} */ name) => {
    if (!places.has(name)) places.set(name, gl.getUniformLocation(handle, name));
    return places.get(name) ?? null;
  };
  return { program: handle, at };
}

/** @param {WebGL2RenderingContext} gl */
function shadowMap(gl) {
  const texture = must(gl.createTexture());
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.texStorage2D(gl.TEXTURE_2D, 1, gl.DEPTH_COMPONENT24, SHADOW_SIZE, SHADOW_SIZE);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.LINEAR);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  const framebuffer = must(gl.createFramebuffer());
  gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, texture, 0);
  gl.drawBuffers([gl.NONE]);
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  return { texture, framebuffer };
}
