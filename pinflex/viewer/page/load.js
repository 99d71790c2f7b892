/* load.js: unpacks the runs and three.js, which the page holds deflated (packing.py). */
function fail(text) { document.getElementById("app").textContent = text; throw new Error(text); }
if (!window.DecompressionStream) fail("This browser is too old to unpack the page. Firefox 113, Safari 16.4, Chrome 80 and all later ones can.");

/* Text of base 85 (view.deflated): five digits are four bytes; at the end, of fewer digits the bytes that they tell. */
const DIGITS = new Uint8Array(128);
[..."0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#$%()*+,-./:;=?@[]^_|~"].forEach((c, i) => { DIGITS[c.charCodeAt(0)] = i; });
async function inflated(id) {
  const text = document.getElementById(id).textContent, bytes = new Uint8Array(Math.floor(4 * text.length / 5));
  for (let i = 0, o = 0; i < text.length; i += 5) {
    let word = 0;
    for (let j = i; j < i + 5; j++) word = 85 * word + (j < text.length ? DIGITS[text.charCodeAt(j)] : 84);
    for (let k = 24; k >= 0; k -= 8) bytes[o++] = word >>> k;
  }
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/* Second differences along the first axis, one series after the other, four bytes apart; then up to
   two along the second axis. Sums are of whole numbers, so nothing is lost. */
function unpacked(bytes, {packed, shape, step, along}) {
  const rows = shape[0], total = shape.reduce((a, b) => a * b, 1), series = rows ? total / rows : 0;
  const whole = new Int32Array(total), out = new Float32Array(total);
  for (let j = 0, p = packed; j < series; j++) for (let i = 0, x = 0, d = 0; i < rows; i++, p++) {
    const z = bytes[p] | bytes[p + total] << 8 | bytes[p + 2 * total] << 16 | bytes[p + 3 * total] << 24;
    d += (z >>> 1) ^ -(z & 1);
    x += d;
    whole[i * series + j] = x;
  }
  const apart = along ? series / shape[1] : 0;
  for (let n = 0; n < along; n++) for (let i = 0; i < rows; i++)
    for (let j = i * series + apart; j < (i + 1) * series; j++) whole[j] += whole[j - apart];
  for (let i = 0; i < total; i++) out[i] = whole[i] * step;
  out.shape = shape;
  out.id = packed;                                 // equal arrays have the same
  return out;
}

async function loaded() {
  const all = await inflated("pinflex-data"), start = 4 + new DataView(all.buffer).getUint32(0, true), arrays = all.subarray(start);
  const known = new Map();                         // equal arrays of several runs are one
  const array = (v) => { if (!known.has(v.packed)) known.set(v.packed, unpacked(arrays, v)); return known.get(v.packed); };
  return JSON.parse(new TextDecoder().decode(all.subarray(4, start)), (key, v) => v && v.packed !== undefined ? array(v) : v);
}

const DATA = await loaded(), code = document.createElement("script");
code.textContent = new TextDecoder().decode(await inflated("pinflex-viewer"));
document.body.append(code);                        // runs at once; the page's policy knows its hash
