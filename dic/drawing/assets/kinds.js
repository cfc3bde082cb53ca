// The kinds of shapes that can be drawn: how many points each has, its values, and the lines that show it.

const REGION = "#ff8c00", HOLE = "#e0457b", CRACK = "#cc79a7", GAUGE = "#56b4e9";

// `points` is the least and the greatest number of points; `values` maps each number to its label and unit.
// A value that may be left empty has `empty`: what the commands use instead.
const KINDS = {
  region: { label: "Region", points: [3, Infinity], closed: true, colour: REGION, file: "region", values: {} },
  hole: { label: "Hole", points: [3, Infinity], closed: true, colour: HOLE, file: "region", values: {} },
  crack: {
    label: "Crack", points: [2, Infinity], colour: CRACK, file: "region",
    values: { width_px: { label: "width, px" } },
  },
  extensometer: {
    label: "Extensometer", points: [2, 2], colour: GAUGE, file: "gauges",
    values: { patch: { label: "patch, px" } },
  },
  transverse: {
    label: "Transverse", points: [2, 2], colour: GAUGE, file: "gauges",
    values: { patch: { label: "patch, px" }, spread: { label: "spread, px" }, lines: { label: "lines" } },
  },
  rectangle: {
    label: "Area", points: [2, 2], colour: GAUGE, file: "gauges", gauge: "area",
    values: {
      width_px: { label: "width, px" }, height_px: { label: "height, px" },
      angle_deg: { label: "turned by, °" }, direction_deg: { label: "strain along, °" },
    },
  },
  polygon: {
    label: "Area polygon", points: [3, Infinity], closed: true, colour: GAUGE, file: "gauges", gauge: "area",
    values: { direction_deg: { label: "strain along, °" } },
  },
  cut: {
    label: "Line cut", points: [2, 2], colour: GAUGE, file: "gauges",
    values: { places: { label: "places" }, width: { label: "width, px", empty: "strain window" } },
  },
  point: {
    label: "Point", points: [1, 1], colour: GAUGE, file: "gauges",
    values: { width: { label: "width, px", empty: "strain window" }, direction_deg: { label: "strain along, °" } },
  },
};

function isGauge(shape) {
  return KINDS[shape.kind].file === "gauges";
}

function gaugeKind(shape) {
  return KINDS[shape.kind].gauge || shape.kind;
}

// The values of a new shape, in proportion to the image.
function firstValues(kind, data) {
  const unit = Math.max(5, Math.round(Math.min(data.width, data.height) / 125) * 5);
  const values = {
    crack: { width_px: 4 },
    extensometer: { patch: unit },
    transverse: { patch: unit, spread: 5 * unit, lines: 40 },
    rectangle: { angle_deg: 0, direction_deg: 0 },
    polygon: { direction_deg: 0 },
    cut: { places: 50, width: null },
    point: { width: null, direction_deg: 0 },
  };
  return { ...(values[kind] || {}) };
}

// A shape from the points that were clicked. The points of a rectangle become its centre and its size.
function newShape(kind, points, name, data) {
  const values = firstValues(kind, data);
  if (kind === "rectangle") {
    const [a, b] = points;
    values.width_px = rounded([Math.abs(b[0] - a[0])])[0];
    values.height_px = rounded([Math.abs(b[1] - a[1])])[0];
    points = [rounded([(a[0] + b[0]) / 2, (a[1] + b[1]) / 2])];
  }
  if ("patch" in values) {
    values.patch = Math.max(1, Math.min(values.patch, Math.floor(distance(points[0], points[1]))));
  }
  return { kind, name, points, values };
}

function cornersOf(shape) {
  const { width_px: width, height_px: height, angle_deg: angle } = shape.values;
  return shape.kind === "rectangle" ? rectangle(shape.points[0], [width, height], angle || 0) : shape.points;
}

// The lines that show a shape: its own line first, then bands, and patches (`around`) around places.
function linesOf(shape) {
  const { points, values } = shape;
  const kind = KINDS[shape.kind];
  if (shape.kind === "rectangle") return [{ points: cornersOf(shape), closed: true }];
  if (shape.kind === "point") {
    const width = values.width || 0;
    const around = width ? [{ points: patch(points[0], [[1, 0], [0, 1]], width), closed: true, thin: true, around: true }] : [];
    return [{ points, cross: true }, ...around];
  }
  const lines = [{ points, closed: kind.closed, width: shape.kind === "crack" ? values.width_px : 0 }];
  if (shape.kind === "extensometer" || shape.kind === "transverse") {
    const axes = axesOf(points[0], points[1]);
    const apart = shape.kind === "transverse" ? [-0.5, 0.5].map((share) => share * (values.spread || 0)) : [];
    for (const shift of [0, ...apart]) {
      const [start, end] = points.map((point) => moved(point, [shift, axes[1]]));
      if (shift !== 0) lines.push({ points: [start, end], thin: true });
      for (const middle of [start, end]) {
        lines.push({ points: patch(middle, axes, values.patch || 0), closed: true, thin: true, around: true });
      }
    }
  }
  return lines;
}
