// Plane geometry of points [x, y], in px of the whole image.

function distance(a, b) {
  return Math.hypot(a[0] - b[0], a[1] - b[1]);
}

function rounded(point) {
  // A tenth of a pixel is finer than a hand can draw.
  return point.map((value) => Math.round(value * 10) / 10 + 0);
}

function side(start, end, point) {
  return Math.sign(
    (end[0] - start[0]) * (point[1] - start[1]) - (end[1] - start[1]) * (point[0] - start[0])
  );
}

function edgesOf(corners) {
  return corners.map((corner, k) => [corner, corners[(k + 1) % corners.length]]);
}

// The place where two edges cross, which is an end of neither; null if they do not cross.
function meeting([a, b], [c, d]) {
  if (side(a, b, c) * side(a, b, d) >= 0 || side(c, d, a) * side(c, d, b) >= 0) return null;
  const along = [b[0] - a[0], b[1] - a[1]];
  const across = [d[0] - c[0], d[1] - c[1]];
  const share =
    ((c[0] - a[0]) * across[1] - (c[1] - a[1]) * across[0]) / (along[0] * across[1] - along[1] * across[0]);
  return [a[0] + share * along[0], a[1] + share * along[1]];
}

// The first place where a polygon crosses itself, or another polygon if one is given; null if none.
function crossing(corners, other = null) {
  const edges = edgesOf(corners);
  const others = other === null ? edges : edgesOf(other);
  for (let k = 0; k < edges.length; k++) {
    for (let m = other === null ? k + 1 : 0; m < others.length; m++) {
      const place = meeting(edges[k], others[m]);
      if (place !== null) return place;
    }
  }
  return null;
}

// Whether a point lies inside a polygon.
function isInside([x, y], corners) {
  const crossed = edgesOf(corners).filter(
    ([a, b]) => a[1] <= y !== b[1] <= y && x < a[0] + ((y - a[1]) / (b[1] - a[1])) * (b[0] - a[0])
  );
  return crossed.length % 2 === 1;
}

function isOnEdge([x, y], [a, b]) {
  const length = distance(a, b);
  const along = ((x - a[0]) * (b[0] - a[0]) + (y - a[1]) * (b[1] - a[1])) / (length || 1);
  const share = Math.min(1, Math.max(0, along / (length || 1)));
  return distance([x, y], moved(a, [share, [b[0] - a[0], b[1] - a[1]]])) < 1e-6;
}

// Which pieces of a polygon's outline lie inside and outside another polygon that it does not cross.
function piecesBeside(corners, other) {
  const edges = edgesOf(other);
  const found = { inside: false, outside: false };
  for (const [a, b] of edgesOf(corners)) {
    const touching = other.filter((corner) => isOnEdge(corner, [a, b])).map((corner) => distance(a, corner));
    const places = [0, ...touching, distance(a, b)].sort((one, next) => one - next);
    for (let k = 1; k < places.length; k++) {
      const share = (places[k - 1] + places[k]) / 2 / (distance(a, b) || 1);
      const middle = moved(a, [share, [b[0] - a[0], b[1] - a[1]]]);
      if (edges.some((edge) => isOnEdge(middle, edge))) continue;
      found[isInside(middle, other) ? "inside" : "outside"] = true;
    }
  }
  return found;
}

// Whether two polygons without a crossing cover each other, and neither lies inside the other.
function overlapsPartly(one, other) {
  const both = [piecesBeside(one, other), piecesBeside(other, one)];
  const equal = both.every((pieces) => !pieces.inside && !pieces.outside);
  return equal || both.some((pieces) => pieces.inside && pieces.outside);
}

// Unit vectors along and across a line; across is 90° to the left of along as the image is seen.
function axesOf(start, end) {
  const length = distance(start, end) || 1;
  const along = [(end[0] - start[0]) / length, (end[1] - start[1]) / length];
  return [along, [along[1], -along[0]]];
}

function moved(point, ...steps) {
  return steps.reduce((at, [share, vector]) => [at[0] + share * vector[0], at[1] + share * vector[1]], point);
}

// Corners of a rectangle. Angles are positive from x upwards, so they are negative in the image's axes.
function rectangle(centre, size, angleDeg) {
  const angle = (-angleDeg * Math.PI) / 180;
  const right = [Math.cos(angle), Math.sin(angle)];
  const down = [-Math.sin(angle), Math.cos(angle)];
  const signs = [[-1, -1], [1, -1], [1, 1], [-1, 1]];
  return signs.map(([a, b]) => moved(centre, [(a * size[0]) / 2, right], [(b * size[1]) / 2, down]));
}

// Corners of the square patch at one end of a line.
function patch(middle, axes, width) {
  const signs = [[-1, -1], [1, -1], [1, 1], [-1, 1]];
  return signs.map(([a, b]) => moved(middle, [(a * width) / 2, axes[0]], [(b * width) / 2, axes[1]]));
}
