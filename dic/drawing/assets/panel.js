// The panel beside the image: tools, the list of shapes, the values of the selected one, and the files.

const HINTS = {
  select: "Click a line to select it. Drag a line or a point to move it, drag elsewhere to pan, wheel to zoom.",
  region: "Click the corners of the surface. Finish by a click on the first corner, a double click, or Enter.",
  hole: "Click the corners of what is left out. Finish by a click on the first corner, a double click, or Enter.",
  crack: "Click along the crack. Finish by a double click or Enter.",
  extensometer: "Click both ends of the gauge length.",
  transverse: "Click both ends of the line in the middle.",
  rectangle: "Click two opposite corners of the area.",
  polygon: "Click the corners of the area. Finish by a click on the first corner, a double click, or Enter.",
  cut: "Click both ends of the line.",
  point: "Click the place.",
};
const TEXTS = { region: regionText, gauges: gaugesText };

function element(tag, values = {}, ...children) {
  const made = Object.assign(document.createElement(tag), values);
  made.append(...children);
  return made;
}

class Panel {
  constructor(tools, view, model) {
    this.tools = tools;
    this.view = view;
    this.model = model;
    this.find = (id) => document.getElementById(id);
    this.makeTools();
    this.find("undo").onclick = () => tools.again("undo");
    this.find("redo").onclick = () => tools.again("redo");
    this.find("delete").onclick = () => tools.remove();
    this.find("closer").onclick = () => view.zoom(1.25);
    this.find("farther").onclick = () => view.zoom(0.8);
    this.find("fit").onclick = () => view.fit();
    this.find("copy").onclick = () => this.copy();
    this.find("close").onclick = () => this.find("text").close();
    for (const file of ["region", "gauges"]) {
      this.find(`save-${file}`).onclick = () => this.save(file);
      this.find(`show-${file}`).onclick = () => this.show(file);
    }
    tools.chosen = (note) => this.mark(note);
    model.onChange(() => this.update());
    view.zoomed = (scale) => {
      this.find("zoom").textContent = `${Math.round(100 * scale)} %`;
    };
  }

  makeTools() {
    for (const kind of ["select", ...Object.keys(KINDS)]) {
      const label = kind === "select" ? "Select" : KINDS[kind].label;
      const button = element("button", { id: `tool-${kind}`, textContent: label, title: HINTS[kind] });
      button.onclick = () => this.tools.choose(kind);
      const group = kind === "select" ? "any" : KINDS[kind].file;
      this.find(`tools-${group}`).append(button);
    }
  }

  mark(note) {
    for (const button of document.querySelectorAll("#tools button[id^=tool-]")) {
      button.classList.toggle("on", button.id === `tool-${this.tools.tool}`);
    }
    this.find("hint").textContent = note || HINTS[this.tools.tool];
  }

  update() {
    const { model } = this;
    const rows = model.shapes.map((shape, number) => this.row(shape, number));
    const kept = model.data.kept.map((one) =>
      element("li", { className: "kept", textContent: `${one.name} (${one.kind}, in mm): ${one.note}` })
    );
    this.find("kept").hidden = kept.length === 0;
    this.find("shapes").replaceChildren(...rows, ...kept);
    this.find("none").hidden = rows.length + kept.length > 0;
    this.find("undo").disabled = model.earlier.length === 0;
    this.find("redo").disabled = model.later.length === 0;
    this.find("delete").disabled = model.selected === null;
    this.values();
    for (const file of ["region", "gauges"]) this.judge(file);
  }

  row(shape, number) {
    const kind = isGauge(shape) ? ` (${gaugeKind(shape)})` : "";
    const button = element("button", { textContent: titleOf(this.model, number) + kind });
    button.style.setProperty("--colour", KINDS[shape.kind].colour);
    button.classList.toggle("on", number === this.model.selected);
    button.onclick = () => {
      this.tools.choose("select");
      this.model.select(number);
    };
    return element("li", {}, button);
  }

  // Fields for the name and the values of the selected shape.
  values() {
    const { shape } = this.model;
    const place = this.find("values");
    if (shape === null) {
      place.replaceChildren();
      return;
    }
    const fields = [];
    if (isGauge(shape)) fields.push(this.field("name", "name", shape.name, (text) => text.trim()));
    for (const [name, { label, empty }] of Object.entries(KINDS[shape.kind].values)) {
      const read = (text) => (text.trim() === "" ? null : Number(text.replace(",", ".")));
      fields.push(this.field(name, label, shape.values[name] ?? "", read, empty));
    }
    const corners = shape.points.map((point) => `${point[0]}, ${point[1]}`).join("\n");
    const title = element("h3", { textContent: titleOf(this.model, this.model.selected) });
    place.replaceChildren(title, ...fields, element("pre", { textContent: corners, title: "x, y in px" }));
  }

  field(name, label, value, read, empty = "") {
    const input = element("input", { id: `value-${name}`, value, placeholder: empty, autocomplete: "off" });
    input.onchange = () => this.model.set(name, read(input.value));
    return element("label", {}, element("span", { textContent: label }), input);
  }

  // Say what keeps the commands from reading a file, and offer the file only if nothing does.
  judge(file) {
    const used = this.model.shapes.some((shape) => KINDS[shape.kind].file === file);
    const kept = file === "gauges" && this.model.data.kept.length > 0;
    const found = problems(this.model, file);
    const shown = used ? found : [];
    const items = shown.map((text) => element("li", { textContent: text }));
    this.find(`problems-${file}`).replaceChildren(...items);
    for (const action of ["save", "show"]) {
      this.find(`${action}-${file}`).disabled = !(used || kept) || found.length > 0;
    }
    this.find(`unsaved-${file}`).hidden = !this.model.unsaved[file] || !(used || kept);
  }

  save(file) {
    const content = new Blob([TEXTS[file](this.model)], { type: "application/toml" });
    const link = element("a", { href: URL.createObjectURL(content), download: this.model.data.files[file] });
    link.click();
    URL.revokeObjectURL(link.href);
    this.model.unsaved[file] = false;
    this.model.tell();
  }

  show(file) {
    this.find("text-name").textContent = this.model.data.files[file];
    this.find("text-content").value = TEXTS[file](this.model);
    this.find("copied").textContent = "";
    this.find("text").showModal();
    this.find("text-content").setSelectionRange(0, 0);
    this.find("text-content").scrollTop = 0;
  }

  async copy() {
    const content = this.find("text-content");
    content.select();
    try {
      await navigator.clipboard.writeText(content.value);
      this.find("copied").textContent = "copied";
    } catch {
      this.find("copied").textContent = "The browser does not allow it: press Ctrl+C.";
    }
  }
}
