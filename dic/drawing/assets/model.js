// The shapes on the image, which one is selected, and the earlier and later states for undo and redo.

class Model {
  constructor(data) {
    this.data = data;
    this.shapes = data.shapes.map((shape) => structuredClone(shape));
    this.selected = null; // number of a shape
    this.corner = null; // number of a point of the selected shape
    this.unsaved = { region: false, gauges: false };
    this.earlier = [];
    this.later = [];
    this.listeners = [];
  }

  onChange(listener) {
    this.listeners.push(listener);
  }

  tell() {
    for (const listener of this.listeners) listener();
  }

  get shape() {
    return this.selected === null ? null : this.shapes[this.selected];
  }

  // Keep the present state for undo; call it before a change.
  keep() {
    this.earlier.push(JSON.stringify(this.shapes));
    this.later = [];
  }

  // Note which files a change of a shape concerns, and tell everyone.
  changed(...shapes) {
    for (const shape of shapes) this.unsaved[KINDS[shape.kind].file] = true;
    this.tell();
  }

  select(number, corner = null) {
    this.selected = number;
    this.corner = corner;
    this.tell();
  }

  add(shape) {
    this.keep();
    this.shapes.push(shape);
    this.selected = this.shapes.length - 1;
    this.corner = null;
    this.changed(shape);
  }

  remove(number) {
    this.keep();
    const [shape] = this.shapes.splice(number, 1);
    this.selected = this.corner = null;
    this.changed(shape);
  }

  // Remove a corner, unless the shape needs it; return whether it was removed.
  removeCorner(number, corner) {
    const shape = this.shapes[number];
    if (shape.points.length <= KINDS[shape.kind].points[0]) return false;
    this.keep();
    shape.points.splice(corner, 1);
    this.corner = null;
    this.changed(shape);
    return true;
  }

  insert(number, after, point) {
    this.keep();
    this.shapes[number].points.splice(after + 1, 0, point);
    this.corner = after + 1;
    this.changed(this.shapes[number]);
  }

  set(name, value) {
    this.keep();
    if (name === "name") this.shape.name = value;
    else this.shape.values[name] = value;
    this.changed(this.shape);
  }

  undo() {
    this.swap(this.earlier, this.later);
  }

  redo() {
    this.swap(this.later, this.earlier);
  }

  swap(from, to) {
    if (from.length === 0) return;
    to.push(JSON.stringify(this.shapes));
    this.shapes = JSON.parse(from.pop());
    this.selected = this.corner = null;
    this.unsaved = { region: true, gauges: true };
    this.tell();
  }

  // A name that no gauge has: the kind and a number.
  freeName(kind) {
    const taken = new Set([...this.shapes.map((shape) => shape.name), ...this.data.kept.map((one) => one.name)]);
    const stem = KINDS[kind].gauge || kind;
    let number = 1;
    while (taken.has(`${stem}-${number}`)) number += 1;
    return `${stem}-${number}`;
  }
}
