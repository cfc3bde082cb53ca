// The text of the two files, and what keeps the commands from reading them.

const NAME = /^[A-Za-z0-9][A-Za-z0-9_-]{0,39}$/;

function pair(point) {
  return `[${rounded(point).join(", ")}]`;
}

function listOf(key, outlines) {
  const lines = outlines.map((corners) => {
    const rows = [];
    for (let k = 0; k < corners.length; k += 8) rows.push(`    ${corners.slice(k, k + 8).map(pair).join(", ")},`);
    return ["  [", ...rows, "  ],"].join("\n");
  });
  return [`${key} = [`, ...lines, "]"].join("\n");
}

function regionText(model) {
  const of = (kind) => model.shapes.filter((shape) => shape.kind === kind);
  const outlines = (kind) => of(kind).map((shape) => shape.points);
  const parts = [
    `# Drawn on ${model.data.name}. Corners [x, y] in px from the centre of the first pixel, y downwards.`,
    "# A polygon inside another one is a hole; holes may also cross outlines.",
    `image_size_px = [${model.data.width}, ${model.data.height}]`,
    listOf("polygons", outlines("region")),
  ];
  if (of("hole").length > 0) parts.push(listOf("holes", outlines("hole")));
  for (const { points, values } of of("crack")) {
    parts.push(`\n[[crack]]\npath = [${points.map(pair).join(", ")}]\nwidth_px = ${values.width_px}`);
  }
  return parts.join("\n") + "\n";
}

// The keys of a gauge that say where it is.
function placesOf(shape) {
  const { kind, points, values } = shape;
  if (kind === "rectangle") {
    const turned = values.angle_deg ? { angle_deg: values.angle_deg } : {};
    return { centre: pair(points[0]), size: pair([values.width_px, values.height_px]), ...turned };
  }
  if (kind === "polygon") return { corners: `[${points.map(pair).join(", ")}]` };
  if (kind === "point") return { at: pair(points[0]) };
  return { start: pair(points[0]), end: pair(points[1]) };
}

function gaugeTable(shape) {
  const keys = { name: `"${shape.name}"`, kind: `"${gaugeKind(shape)}"`, ...placesOf(shape) };
  const inPlaces = shape.kind === "rectangle" ? ["width_px", "height_px", "angle_deg"] : [];
  for (const [key, value] of Object.entries(shape.values)) {
    if (value !== null && !inPlaces.includes(key)) keys[key] = value;
  }
  return ["[[gauge]]", ...Object.entries(keys).map(([key, value]) => `${key} = ${value}`)].join("\n");
}

function gaugesText(model) {
  const tables = [...model.shapes.filter(isGauge).map(gaugeTable), ...model.data.kept.map((one) => one.text)];
  return [`# Drawn on ${model.data.name}. Places in px, x to the right, y downwards.`, ...tables].join("\n\n") + "\n";
}

function at(point) {
  return `(${rounded(point).join(", ")})`;
}

// Sentences about what keeps the commands from reading a file; an empty list if they can.
function problems(model, file) {
  return file === "region" ? regionProblems(model) : gaugeProblems(model);
}

function regionProblems(model) {
  const found = [];
  const outlines = [];
  model.shapes.forEach((shape, number) => {
    const label = titleOf(model, number);
    if (shape.kind === "crack" && !inRange(shape.values.width_px, 1, 1000)) {
      found.push(`${label}: give a width from 1 to 1000 px.`);
    }
    if (shape.kind !== "region" && shape.kind !== "hole") return;
    const place = crossing(shape.points);
    if (place) found.push(`${label}: its edges cross at ${at(place)}; move the corners beside it.`);
    if (shape.kind === "region") outlines.push([label, shape.points]);
  });
  for (let k = 0; k < outlines.length; k++) {
    for (let m = k + 1; m < outlines.length; m++) {
      const place = crossing(outlines[k][1], outlines[m][1]);
      if (place) {
        found.push(
          `${outlines[k][0]} and ${outlines[m][0]} cross at ${at(place)}; draw one around both, or make one a hole.`
        );
      } else if (overlapsPartly(outlines[k][1], outlines[m][1])) {
        found.push(`${outlines[k][0]} and ${outlines[m][0]} overlap; draw one around both, or make one a hole.`);
      }
    }
  }
  if (outlines.length === 0) found.push("Draw at least one region.");
  return found;
}

function gaugeProblems(model) {
  const found = [];
  const names = [...model.data.kept.map((one) => one.name)];
  model.shapes.forEach((shape, number) => {
    if (!isGauge(shape)) return;
    const label = titleOf(model, number);
    if (!NAME.test(shape.name)) found.push(`${label}: give a name of letters, digits, _ and -, at most 40.`);
    if (names.includes(shape.name)) found.push(`${label}: another gauge has this name; rename one.`);
    names.push(shape.name);
    found.push(...valueProblems(shape).map((text) => `${label}: ${text}.`));
    const outside = linesOf(shape).some((line) => !line.around && line.points.some((point) => !inside(point, model.data)));
    if (outside) found.push(`${label}: move it into the image.`);
  });
  if (names.length === 0) found.push("Draw at least one gauge.");
  return found;
}

function valueProblems({ kind, points, values }) {
  const found = [];
  for (const name of ["patch", "spread", "width_px", "height_px"]) {
    if (name in values && !inRange(values[name], 0.001, 1e5)) found.push(`give a ${name} above 0`);
  }
  if (values.width !== undefined && values.width !== null && !inRange(values.width, 0.001, 1e5)) {
    found.push("give a width above 0, or leave it empty");
  }
  if ("patch" in values && values.patch > distance(points[0], points[1])) {
    found.push("make the patch smaller than the gauge is long");
  }
  if ("lines" in values && !(Number.isInteger(values.lines) && inRange(values.lines, 32, 10000))) {
    found.push("give a whole number of lines from 32 to 10000");
  }
  if ("places" in values && !(Number.isInteger(values.places) && inRange(values.places, 2, 2000))) {
    found.push("give a whole number of places from 2 to 2000");
  }
  for (const name of ["angle_deg", "direction_deg"]) {
    if (name in values && !inRange(values[name], -360, 360)) found.push("give an angle from -360° to 360°");
  }
  return found;
}

function inRange(value, least, greatest) {
  return typeof value === "number" && value >= least && value <= greatest;
}

function inside([x, y], data) {
  return x >= 0 && y >= 0 && x <= data.width - 1 && y <= data.height - 1;
}

// "Region 2", or the name of a gauge.
function titleOf(model, number) {
  const shape = model.shapes[number];
  if (isGauge(shape)) return shape.name;
  const before = model.shapes.slice(0, number + 1).filter((one) => one.kind === shape.kind);
  return `${KINDS[shape.kind].label} ${before.length}`;
}
