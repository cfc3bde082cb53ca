// Draws image, shapes and handles by Konva. Everything is in px of the whole image; the stage zooms and pans.

const HANDLE = 6, HIT = 14, LEAST_BETWEEN = 34; // px of the screen
const LARGEST_ZOOM = 60;

class View {
  constructor(place, data, model) {
    this.place = place;
    this.data = data;
    this.model = model;
    this.stage = new Konva.Stage({ container: place, width: place.clientWidth, height: place.clientHeight });
    this.pictures = new Konva.Layer({ listening: false });
    this.drawn = new Konva.Layer();
    this.stage.add(this.pictures, this.drawn);
    this.draft = null; // the kind and the points of a shape that is being drawn, and the pointer's place
    this.fitted = true; // whether the whole image is shown, also after a change of the window's size
    this.zoomed = () => {};
  }

  // Show the picture. A reduced picture may reach beyond the image by less than one of its pixels.
  async show(source) {
    const picture = new Image();
    picture.src = source;
    await picture.decode();
    const { reduction } = this.data;
    const size = { width: picture.width * reduction, height: picture.height * reduction };
    const { width, height } = this.data;
    const group = new Konva.Group({ clip: { x: -0.5, y: -0.5, width, height } });
    group.add(new Konva.Image({ image: picture, x: -0.5, y: -0.5, ...size }));
    this.pictures.add(group);
    this.fit();
  }

  get scale() {
    return this.stage.scaleX();
  }

  resize() {
    this.stage.size({ width: this.place.clientWidth, height: this.place.clientHeight });
    if (this.fitted) this.fit();
    else this.draw();
  }

  fit() {
    const [across, down] = [this.stage.width(), this.stage.height()];
    const scale = 0.96 * Math.min(across / this.data.width, down / this.data.height);
    this.stage.scale({ x: scale, y: scale });
    this.stage.position({
      x: (across - (this.data.width - 1) * scale) / 2,
      y: (down - (this.data.height - 1) * scale) / 2,
    });
    this.fitted = true;
    this.draw();
  }

  // Zoom, keeping a place of the screen where it is; without a place, the middle.
  zoom(factor, at = { x: this.stage.width() / 2, y: this.stage.height() / 2 }) {
    const least = Math.min(this.stage.width() / this.data.width, this.stage.height() / this.data.height) / 4;
    const scale = Math.min(LARGEST_ZOOM, Math.max(least, this.scale * factor));
    const x = (at.x - this.stage.x()) / this.scale;
    const y = (at.y - this.stage.y()) / this.scale;
    this.stage.scale({ x: scale, y: scale });
    this.stage.position({ x: at.x - x * scale, y: at.y - y * scale });
    this.fitted = false;
    this.draw();
  }

  pan(dx, dy) {
    this.stage.position({ x: this.stage.x() + dx, y: this.stage.y() + dy });
    this.fitted = false;
    this.draw();
  }

  pointer() {
    const { x, y } = this.stage.getRelativePointerPosition() || { x: NaN, y: NaN };
    return [x, y];
  }

  onScreen(point) {
    return [this.stage.x() + point[0] * this.scale, this.stage.y() + point[1] * this.scale];
  }

  draw() {
    // Large pixels are shown as squares, so that an edge can be told to the pixel.
    this.pictures.imageSmoothingEnabled(this.scale * this.data.reduction < 2);
    this.pictures.batchDraw();
    this.drawn.destroyChildren();
    this.drawFill();
    this.drawn.add(...this.data.kept.flatMap((one) => one.lines.map((points) => this.keptLine(points))));
    this.model.shapes.forEach((shape, number) => this.drawShape(shape, number));
    if (this.model.shape !== null) this.drawHandles(this.model.shape, this.model.selected);
    if (this.draft !== null) this.drawDraft();
    this.drawn.batchDraw();
    this.zoomed(this.scale);
  }

  // Tint what will be measured: the pixels inside an odd number of regions, less holes.
  drawFill() {
    const outlines = (kind) => this.model.shapes.filter((shape) => shape.kind === kind).map((one) => one.points);
    const fill = (colour, polygons) =>
      new Konva.Shape({
        listening: false,
        fill: colour,
        fillRule: "evenodd",
        sceneFunc: (context, shape) => {
          context.beginPath();
          for (const corners of polygons) {
            corners.forEach(([x, y], k) => (k === 0 ? context.moveTo(x, y) : context.lineTo(x, y)));
            context.closePath();
          }
          context.fillShape(shape);
        },
      });
    this.drawn.add(fill("rgba(255, 140, 0, 0.22)", outlines("region")));
    for (const corners of outlines("hole")) this.drawn.add(fill("rgba(20, 20, 30, 0.55)", [corners]));
  }

  drawShape(shape, number) {
    const selected = number === this.model.selected;
    const { colour } = KINDS[shape.kind];
    for (const line of linesOf(shape)) {
      const width = line.thin ? 1.2 : selected ? 3.5 : 2;
      const own = { role: "shape", number };
      if (line.cross) this.drawn.add(...this.cross(line.points[0], colour, width, own));
      else this.drawn.add(...this.line(line, colour, width, own));
    }
    if (isGauge(shape)) this.drawn.add(this.label(shape.name, cornersOf(shape)[0], colour));
  }

  // A line with a dark one under it, which is seen on every grey level. A crack shows its width too.
  line({ points, closed = false, width: crack = 0 }, colour, width, own = {}) {
    const shared = { points: points.flat(), closed, lineJoin: "round", strokeScaleEnabled: false };
    const under = { ...shared, listening: false, stroke: "rgba(0, 0, 0, 0.65)", strokeWidth: width + 2 };
    const over = { ...shared, stroke: colour, strokeWidth: width, hitStrokeWidth: HIT, fillEnabled: false, ...own };
    const lines = [new Konva.Line(under), new Konva.Line(over)];
    if (crack) {
      const band = { stroke: colour, opacity: 0.5, strokeWidth: crack, strokeScaleEnabled: true, lineCap: "round" };
      lines.unshift(new Konva.Line({ ...under, ...band }));
    }
    return lines;
  }

  cross([x, y], colour, width, own) {
    const reach = 9 / this.scale;
    return [[reach, 0], [0, reach]].flatMap(([dx, dy]) =>
      this.line({ points: [[x - dx, y - dy], [x + dx, y + dy]] }, colour, width, own)
    );
  }

  keptLine(points) {
    const dash = [6, 4];
    const style = { stroke: GAUGE, strokeWidth: 1.5, strokeScaleEnabled: false, dash, listening: false };
    return new Konva.Line({ points: points.flat(), ...style });
  }

  label(text, [x, y], colour) {
    const scale = 1 / this.scale;
    const label = new Konva.Label({ x: x + 10 * scale, y: y + 8 * scale, scaleX: scale, scaleY: scale });
    label.listening(false);
    label.add(new Konva.Tag({ fill: "rgba(0, 0, 0, 0.65)", cornerRadius: 3 }));
    label.add(new Konva.Text({ text, fontSize: 12, padding: 3, fill: colour }));
    return label;
  }

  drawHandles(shape, number) {
    const handle = ([x, y], role, corner, style) =>
      new Konva.Circle({
        x, y, radius: HANDLE / this.scale, stroke: "#111", strokeWidth: 1.5, strokeScaleEnabled: false,
        fill: "#fff", hitStrokeWidth: 8, role, number, corner, ...style,
      });
    const kind = KINDS[shape.kind];
    if (shape.kind !== "point" && kind.points[1] === Infinity) {
      const edges = kind.closed ? edgesOf(shape.points) : edgesOf(shape.points).slice(0, -1);
      edges.forEach(([a, b], k) => {
        if (distance(a, b) * this.scale < LEAST_BETWEEN) return;
        const middle = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
        this.drawn.add(handle(middle, "middle", k, { radius: 4 / this.scale, opacity: 0.6, fill: "#ddd" }));
      });
    }
    if (shape.kind === "rectangle") {
      cornersOf(shape).forEach((point, k) => this.drawn.add(handle(point, "size", k, {})));
    }
    shape.points.forEach((point, k) => {
      const active = k === this.model.corner ? { fill: "#ffd400", radius: (HANDLE + 2) / this.scale } : {};
      this.drawn.add(handle(point, "corner", k, active));
    });
  }

  drawDraft() {
    const { kind, points, pointer } = this.draft;
    const { colour, closed } = KINDS[kind];
    const all = pointer ? [...points, pointer] : points;
    const corners = kind === "rectangle" && all.length === 2 ? boxOf(all) : all;
    if (corners.length > 1) {
      const full = kind === "rectangle" || (closed && corners.length > 2);
      this.drawn.add(...this.line({ points: corners, closed: full }, colour, 2, { listening: false }));
    }
    for (const [k, [x, y]] of points.entries()) {
      const first = k === 0 && closed && points.length > 2;
      const radius = (first ? HANDLE + 3 : HANDLE - 2) / this.scale;
      const style = { stroke: "#111", strokeWidth: 1.5, strokeScaleEnabled: false, listening: false };
      this.drawn.add(new Konva.Circle({ x, y, radius, fill: first ? "#ffd400" : "#fff", ...style }));
    }
  }
}

function boxOf([[left, top], [right, bottom]]) {
  return [[left, top], [right, top], [right, bottom], [left, bottom]];
}
