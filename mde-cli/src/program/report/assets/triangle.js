// Triangles with a depth buffer.

/** Draws corners of `screen`, which has place and distance of each, with their colours mixed; nothing where a distance is not positive. */
function fillTriangle({ words, buffer, wide, high }, screen, [a, b, c], colours) {
  const [za, zb, zc] = [screen[3 * a + 2], screen[3 * b + 2], screen[3 * c + 2]];
  if (!(za > 0 && zb > 0 && zc > 0)) return;
  const [xa, ya, xb, yb, xc, yc] = [screen[3 * a], screen[3 * a + 1], screen[3 * b], screen[3 * b + 1], screen[3 * c], screen[3 * c + 1]];
  const twice = (xb - xa) * (yc - ya) - (xc - xa) * (yb - ya);
  if (twice === 0) return;
  const corners = [colours[a], colours[b], colours[c]];
  const left = Math.max(0, Math.ceil(Math.min(xa, xb, xc) - 0.5)), right = Math.min(wide - 1, Math.floor(Math.max(xa, xb, xc) - 0.5));
  const top = Math.max(0, Math.ceil(Math.min(ya, yb, yc) - 0.5)), bottom = Math.min(high - 1, Math.floor(Math.max(ya, yb, yc) - 0.5));
  for (let y = top; y <= bottom; y += 1) {
    for (let x = left; x <= right; x += 1) {
      const [u, v] = [x + 0.5, y + 0.5];
      const wb = ((u - xa) * (yc - ya) - (xc - xa) * (v - ya)) / twice, wc = ((xb - xa) * (v - ya) - (u - xa) * (yb - ya)) / twice;
      if (wb < 0 || wc < 0 || wb + wc > 1) continue;
      const z = za + wb * (zb - za) + wc * (zc - za), at = y * wide + x;
      if (!(z < buffer[at])) continue;
      const mixed = (shift) => ((corners[0] >>> shift) & 255) * (1 - wb - wc) + ((corners[1] >>> shift) & 255) * wb + ((corners[2] >>> shift) & 255) * wc;
      buffer[at] = z;
      words[at] = 0xff000000 | (mixed(16) << 16) | (mixed(8) << 8) | mixed(0);
    }
  }
}
