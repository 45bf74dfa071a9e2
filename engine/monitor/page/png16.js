// @ts-check
/** Reads 16-bit grey PNGs, which browsers only decode to 8 bits. */

/**
 * @param {ArrayBuffer} buffer
 * @returns {Promise<{width: number, height: number, values: Uint16Array}>} row-major samples, as stored
 */
export async function decodePng16(buffer) {
  const view = new DataView(buffer);
  if (view.byteLength < 33 || view.getUint32(0) !== 0x89504e47) throw new Error("this is no PNG");
  const [width, height] = [view.getUint32(16), view.getUint32(20)];
  const [bits, kind, interlaced] = [view.getUint8(24), view.getUint8(25), view.getUint8(28)];
  if (bits !== 16 || kind !== 0 || interlaced !== 0) throw new Error(`expected a plain 16-bit grey PNG, found ${bits} bits, type ${kind}`);
  const parts = [];
  for (let at = 8; at + 8 <= view.byteLength;) {
    const length = view.getUint32(at);
    if (view.getUint32(at + 4) === 0x49444154) parts.push(new Uint8Array(buffer, at + 8, length));
    at += length + 12;
  }
  const stream = new Blob(parts).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  return { width, height, values: unfilter(bytes, width, height) };
}

/** @param {Uint8Array} bytes @param {number} width @param {number} height */
function unfilter(bytes, width, height) {
  const stride = 2 * width;
  if (bytes.length < (stride + 1) * height) throw new Error("the PNG is cut off");
  const values = new Uint16Array(width * height);
  let above = new Uint8Array(stride);
  let row = new Uint8Array(stride);
  for (let y = 0; y < height; y += 1) {
    const filter = bytes[y * (stride + 1)];
    const from = y * (stride + 1) + 1;
    for (let i = 0; i < stride; i += 1) {
      const left = i >= 2 ? row[i - 2] : 0;
      const corner = i >= 2 ? above[i - 2] : 0;
      row[i] = bytes[from + i] + predict(filter, left, above[i], corner);
    }
    for (let x = 0; x < width; x += 1) values[y * width + x] = (row[2 * x] << 8) | row[2 * x + 1];
    [above, row] = [row, above];
  }
  return values;
}

/** @param {number} filter @param {number} left @param {number} above @param {number} corner */
function predict(filter, left, above, corner) {
  if (filter === 1) return left;
  if (filter === 2) return above;
  if (filter === 3) return (left + above) >> 1;
  if (filter !== 4) return 0;
  const guess = left + above - corner;
  const [a, b, c] = [Math.abs(guess - left), Math.abs(guess - above), Math.abs(guess - corner)];
  return a <= b && a <= c ? left : b <= c ? above : corner;
}
