// Start the page: read its data, show the image, and show where the pointer is.

const data = JSON.parse(document.getElementById("data").textContent);
const model = new Model(data);
const view = new View(document.getElementById("image"), data, model);
const tools = new Tools(view, model);
const panel = new Panel(tools, view, model);

// Millimetres on the specimen between the nodes of the calibration; null outside of the calibrated area.
function millimetres([x, y]) {
  if (data.calibration === null) return null;
  const { x: columns, y: rows, mm, outline } = data.calibration;
  const cell = (nodes, value) => {
    const size = nodes[1] - nodes[0];
    const k = Math.min(nodes.length - 2, Math.max(0, Math.floor((value - nodes[0]) / size)));
    return [k, (value - nodes[k]) / size];
  };
  if (!isInside([x, y], outline)) return null;
  const [i, v] = cell(rows, y);
  const [j, u] = cell(columns, x);
  const around = [mm[i][j], mm[i][j + 1], mm[i + 1][j], mm[i + 1][j + 1]];
  const shares = [(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v];
  return [0, 1].map((axis) => around.reduce((sum, node, k) => sum + shares[k] * node[axis], 0));
}

function showPlace() {
  const point = view.pointer();
  const onImage = point[0] >= -0.5 && point[1] >= -0.5 && point[0] <= data.width - 0.5 && point[1] <= data.height - 0.5;
  const text = onImage ? `x ${point[0].toFixed(1)}  y ${point[1].toFixed(1)} px` : "beside the image";
  const mm = onImage ? millimetres(point) : null;
  const signs = data.calibration === null || !onImage ? "" : "   outside of the calibration";
  document.getElementById("place").textContent =
    text + (mm ? `   X ${mm[0].toFixed(3)}  Y ${mm[1].toFixed(3)} mm` : signs);
}

model.onChange(() => view.draw());
view.stage.on("pointermove", showPlace);
new ResizeObserver(() => view.resize()).observe(view.place);
window.addEventListener("beforeunload", (event) => {
  if (model.unsaved.region || model.unsaved.gauges) event.preventDefault();
});
tools.choose("select");
panel.update();
view.show(data.picture).then(() => document.body.setAttribute("data-ready", "true"));
