// Numbers of the page: five-byte and eight-byte doubles, single precision, sixteen-bit levels, compressed text.
"use strict";
const pilotgen = {};

pilotgen.decode = (() => {
  function bytes(text) {
    const binary = atob(text);
    const found = new Uint8Array(binary.length);
    for (let k = 0; k < binary.length; k += 1) found[k] = binary.charCodeAt(k);
    return found;
  }

  function short(text) {
    const packed = bytes(text);
    const count = packed.length / 5;
    const found = new Float64Array(count);
    const raw = new Uint8Array(found.buffer);
    for (let k = 0; k < count; k += 1) {
      for (let j = 0; j < 5; j += 1) raw[8 * k + 7 - j] = packed[5 * k + j];
    }
    return found;
  }

  const wide = (text) => new Float64Array(bytes(text).buffer);
  const floats = (text) => new Float32Array(bytes(text).buffer);
  const levels = (text) => new Int16Array(bytes(text).buffer);

  async function unzipped(text) {
    const stream = new Blob([bytes(text)]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).text();
  }

  return { short, wide, floats, levels, unzipped };
})();
