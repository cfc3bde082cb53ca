// What pointer and keys do: draw a shape click by click, move shapes and corners, zoom and pan.

const NEAR = 10, STILL = 4; // px of the screen

class Tools {
  constructor(view, model) {
    this.view = view;
    this.model = model;
    this.tool = "select";
    this.action = null; // what the pressed pointer does
    this.chosen = () => {};
    const { stage } = view;
    stage.on("pointerdown", (event) => this.press(event));
    stage.on("pointermove", (event) => this.move(event));
    window.addEventListener("pointerup", (event) => this.release(event));
    stage.on("wheel", (event) => this.wheel(event));
    stage.container().addEventListener("contextmenu", (event) => event.preventDefault());
    window.addEventListener("keydown", (event) => this.key(event));
  }

  choose(tool) {
    this.tool = tool;
    this.view.draft = tool === "select" ? null : { kind: tool, points: [], pointer: null };
    if (tool !== "select") this.model.select(null);
    this.view.place.style.cursor = tool === "select" ? "default" : "crosshair";
    this.view.draw();
    this.chosen();
  }

  // Corners of regions may lie on the outer edge of the image; places of gauges lie on its pixels.
  inImage(point, kind) {
    const margin = KINDS[kind].file === "region" ? 0.5 : 0;
    const sides = [this.view.data.width, this.view.data.height];
    return rounded(point.map((value, k) => Math.min(sides[k] - 1 + margin, Math.max(-margin, value))));
  }

  press({ evt, target }) {
    const role = target.getAttr("role");
    const start = [evt.clientX, evt.clientY];
    const number = target.getAttr("number");
    const corner = target.getAttr("corner");
    this.action = { what: "pan", start, last: start, moved: false };
    if (this.tool !== "select" || evt.button === 1) return;
    if (evt.button === 2) {
      this.action = null;
      if (role === "corner") this.removeCorner(number, corner);
      return;
    }
    const from = this.view.pointer();
    const kept = role === undefined || role === "middle" ? null : structuredClone(this.model.shapes[number]);
    if (role === "corner" || role === "size") {
      this.action = { ...this.action, what: role, number, corner, kept, from };
      if (role === "corner") this.model.select(number, corner);
    } else if (role === "middle") {
      this.model.insert(number, corner, rounded(from));
      this.action = { ...this.action, what: "corner", number, corner: corner + 1, noted: true, from };
    } else if (role === "shape") {
      this.action = { ...this.action, what: "whole", number, kept, from };
      this.model.select(number);
    }
  }

  move({ evt }) {
    const pointer = this.view.pointer();
    if (this.view.draft !== null) this.view.draft.pointer = this.inImage(pointer, this.tool);
    const { action } = this;
    if (action !== null) {
      action.moved ||= distance(action.start, [evt.clientX, evt.clientY]) > STILL;
      if (action.moved) this.drag(action, pointer, evt);
    }
    if (this.view.draft !== null) this.view.draw();
  }

  drag(action, pointer, evt) {
    if (action.what === "pan") {
      this.view.pan(evt.clientX - action.last[0], evt.clientY - action.last[1]);
      action.last = [evt.clientX, evt.clientY];
      return;
    }
    if (!action.noted) this.model.keep();
    action.noted = true;
    const shape = this.model.shapes[action.number];
    if (action.what === "corner") shape.points[action.corner] = this.inImage(pointer, shape.kind);
    else if (action.what === "size") resizeRectangle(shape, action, rounded(pointer));
    else {
      const step = [pointer[0] - action.from[0], pointer[1] - action.from[1]];
      shape.points = action.kept.points.map((point) => rounded(moved(point, [1, step])));
    }
    this.model.changed(shape);
  }

  release(evt) {
    const { action } = this;
    this.action = null;
    if (action === null || action.moved || evt.button === 1) return;
    if (this.tool === "select") {
      if (action.what === "pan") this.model.select(null);
    } else if (evt.button === 0) {
      this.click(this.view.pointer());
    }
  }

  click(pointer) {
    const { draft } = this.view;
    const kind = KINDS[this.tool];
    const near = (point) => distance(this.view.onScreen(point), this.view.onScreen(pointer)) < NEAR;
    const { points } = draft;
    if (points.length >= kind.points[0] && kind.points[1] === Infinity) {
      const again = near(points[points.length - 1]);
      if (again || (kind.closed && near(points[0]))) {
        this.finish();
        return;
      }
    }
    const point = this.inImage(pointer, this.tool);
    const twice = points.length > 0 && distance(points[points.length - 1], point) === 0;
    if (!twice) points.push(point);
    if (points.length === kind.points[1]) this.finish();
    this.view.draw();
  }

  // Make a shape of the points that were clicked, if they suffice.
  finish() {
    const { draft } = this.view;
    const kind = this.tool;
    if (draft === null || draft.points.length < KINDS[kind].points[0]) return;
    const name = KINDS[kind].file === "gauges" ? this.model.freeName(kind) : "";
    const shape = newShape(kind, draft.points, name, this.view.data);
    this.choose("select");
    this.model.add(shape);
  }

  wheel({ evt }) {
    evt.preventDefault();
    this.view.zoom(Math.exp(-0.0015 * evt.deltaY), this.view.stage.getPointerPosition());
  }

  removeCorner(number, corner) {
    if (!this.model.removeCorner(number, corner)) this.chosen("This shape needs all of its points.");
  }

  remove() {
    const { selected, corner } = this.model;
    if (selected === null) return;
    if (corner !== null && KINDS[this.model.shape.kind].points[1] === Infinity) this.removeCorner(selected, corner);
    else this.model.remove(selected);
  }

  key(event) {
    if (event.target.matches("input, textarea") || document.querySelector("dialog[open]")) return;
    const control = event.ctrlKey || event.metaKey;
    const name = event.key.toLowerCase();
    if (control && (name === "y" || (name === "z" && event.shiftKey))) this.again("redo");
    else if (control && name === "z") this.again("undo");
    else if (control) return;
    else if (name === "escape") this.choose("select");
    else if (name === "enter") this.finish();
    else if (name === "backspace" && this.view.draft !== null) this.again("undo");
    else if (name === "delete" || name === "backspace") this.remove();
    else if (name === "+") this.view.zoom(1.25);
    else if (name === "-") this.view.zoom(0.8);
    else if (name === "0") this.view.fit();
    else return;
    event.preventDefault();
  }

  // Undo or redo. While a shape is being drawn, undo takes back its last point.
  again(what) {
    const { draft } = this.view;
    if (what === "undo" && draft !== null && draft.points.length > 0) {
      draft.points.pop();
      this.view.draw();
    } else {
      this.model[what]();
    }
  }
}

// Move one corner of a rectangle; the opposite corner stays.
function resizeRectangle(shape, { kept, corner }, pointer) {
  const fixed = cornersOf(kept)[(corner + 2) % 4];
  const angle = (-(kept.values.angle_deg || 0) * Math.PI) / 180;
  const step = [pointer[0] - fixed[0], pointer[1] - fixed[1]];
  const across = Math.abs(step[0] * Math.cos(angle) + step[1] * Math.sin(angle));
  const down = Math.abs(-step[0] * Math.sin(angle) + step[1] * Math.cos(angle));
  [shape.values.width_px, shape.values.height_px] = rounded([Math.max(across, 1), Math.max(down, 1)]);
  shape.points = [rounded([(fixed[0] + pointer[0]) / 2, (fixed[1] + pointer[1]) / 2])];
}
