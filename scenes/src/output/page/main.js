// The page: what is shown, and what there is to be known about the element under the pointer.

const $ = (id) => document.getElementById(id);

function main() {
  const scene = readScene();
  const mesh = triangles(scene);
  const canvas = $("view");
  const drawing = new Drawing(canvas, scene, mesh);
  const camera = new Camera(scene);
  const list = quantities(scene);
  const state = { quantity: list[0], band: -1, range: [0, 1], picked: null, pointer: null };

  $("title").textContent = scene.title;
  document.title = `${scene.title} – farfield radiosity`;
  list.forEach(({ id, name }) => $("quantity").append(new Option(name, id)));
  $("band").append(new Option("mean of all", "-1"));
  for (let k = 0; k < scene.bands; k++) $("band").append(new Option(bandName(scene, k), String(k)));
  const said = new URLSearchParams(location.hash.slice(1));
  obey(said, list);
  paintBar(scene.palette);
  if (innerWidth < 760 || innerHeight < 560) document.querySelector("#panel > details").open = false;

  let waiting = false;
  const redraw = () => {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      if (state.pointer) pick(state.pointer);
      draw();
    });
  };

  function draw() {
    drawing.draw(camera, {
      isLight: state.quantity.id === "light",
      exposure: scene.exposure * 2 ** Number($("exposure").value),
      range: state.range,
      lines: $("lines").checked,
      picked: state.picked,
      ground: groundColour(),
    });
  }

  /** Takes what the controls say. */
  function take({ keepRange = false } = {}) {
    state.quantity = list.find(({ id }) => id === $("quantity").value);
    const isLight = state.quantity.id === "light";
    const hasBands = Boolean(state.quantity.banded) && scene.bands > 1;
    state.band = hasBands ? Number($("band").value) : -1;
    $("band-row").hidden = !hasBands;
    $("exposure-row").hidden = !isLight;
    $("range-row").hidden = isLight;
    $("scale").hidden = isLight;
    $("stops").textContent = `${Number($("exposure").value).toFixed(1)} stops`;
    if (!keepRange) {
      state.range = rangeOf(scene, state.quantity, state.band);
      $("low").value = shown(state.range[0]);
      $("high").value = shown(state.range[1]);
      drawing.show(valuesAt(scene, mesh, state.quantity, state.band, $("smooth").checked));
    }
    paintScale(state.quantity, state.range);
    redraw();
  }

  function pick([x, y]) {
    state.picked = drawing.elementAt(camera, x, y);
    showElement(scene, state.picked);
  }

  for (const id of ["quantity", "band", "smooth"]) $(id).addEventListener("change", () => take());
  $("lines").addEventListener("change", redraw);
  $("exposure").addEventListener("input", () => take({ keepRange: true }));
  for (const id of ["low", "high"]) {
    $(id).addEventListener("change", () => {
      const range = [Number($("low").value), Number($("high").value)];
      if (range.every(Number.isFinite) && range[1] > range[0]) state.range = range;
      take({ keepRange: true });
    });
  }
  const showWay = () => {
    $("walk").checked = camera.walks;
    $("orbit").checked = !camera.walks;
  };
  const changeWay = (walks) => {
    camera.walks = walks;
    showWay();
  };
  const goHome = () => {
    camera.home();
    showWay();
    redraw();
  };
  $("walk").addEventListener("change", () => changeWay(true));
  $("orbit").addEventListener("change", () => changeWay(false));
  $("home").addEventListener("click", goHome);

  listen(canvas, camera, {
    changed: redraw,
    pointed(place) {
      state.pointer = place;
      if (!place) {
        state.picked = null;
        showElement(scene, null);
      }
      redraw();
    },
    centred(place) {
      const element = drawing.elementAt(camera, ...place);
      if (element === null) return;
      camera.lookAt(middleOf(scene, element));
      showWay();
      redraw();
    },
  });
  window.addEventListener("keydown", (event) => {
    if (!isForScene(event)) return;
    if (event.code === "KeyL") $("lines").click();
    else if (event.code === "KeyM") changeWay(!camera.walks);
    else if (event.code === "KeyH") goHome();
    else if (event.code === "Enter") {
      // For those without a pointer, what is in the middle counts.
      state.pointer = [0.5 * canvas.clientWidth, 0.5 * canvas.clientHeight];
      $("cross").hidden = false;
      redraw();
    }
  });
  canvas.addEventListener("pointermove", () => ($("cross").hidden = true));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  showWay();
  take();
  // Before the page is painted, at first and whenever its size changes: a later frame may never come.
  new ResizeObserver(() => {
    if (said.has("at")) {
      const [x, y] = said.get("at").split(",").map(Number);
      pick([x * canvas.clientWidth, y * canvas.clientHeight]);
    }
    draw();
  }).observe(canvas);
}

/** What a band is called. */
function bandName(scene, k) {
  return scene.bands === 3 ? ["red", "green", "blue"][k] : `${k + 1}`;
}

/**
 * Takes what the address says after its #, such as #show=irradiance&band=0&lines&flat&exposure=1&at=0.5,0.5, a place in
 * shares of the picture: so views can be linked to.
 */
function obey(said, list) {
  const band = String(Number(said.get("band") ?? -1));
  if (list.some(({ id }) => id === said.get("show"))) $("quantity").value = said.get("show");
  if ([...$("band").options].some(({ value }) => value === band)) $("band").value = band;
  if (said.has("lines")) $("lines").checked = true;
  if (said.has("flat")) $("smooth").checked = false;
  if (said.has("exposure")) $("exposure").value = said.get("exposure");
}

/** The colour behind the scene, as three fractions. */
function groundColour() {
  const code = getComputedStyle(document.documentElement).getPropertyValue("--ground").trim();
  return [1, 3, 5].map((k) => parseInt(code.slice(k, k + 2), 16) / 255);
}

/** The bar of a scale, from its upper end down. */
function paintBar(palette) {
  const stops = [];
  for (let k = palette.length - 3; k >= 0; k -= 24) stops.push(`rgb(${palette.slice(k, k + 3).join(" ")})`);
  $("bar").style.background = `linear-gradient(${stops.join(", ")})`;
}

/** The numbers beside the bar. */
function paintScale({ name, unit }, [low, high]) {
  $("unit").textContent = unit ? `${name} [${unit}]` : name;
  const marks = ticks([low, high]).map((value) => {
    const mark = document.createElement("li");
    mark.textContent = shown(Math.abs(value) < 1e-9 * (high - low) ? 0 : value);
    mark.style.top = `${high > low ? (100 * (high - value)) / (high - low) : 50}%`;
    return mark;
  });
  $("marks").replaceChildren(...marks);
}

/** What is known of an element. */
function showElement(scene, element) {
  $("element").hidden = element === null;
  if (element === null) return;
  const { bands } = scene;
  const surface = scene.surfaces[element];
  const part = scene.parts.findLast(({ first }) => first <= surface);
  const material = scene.materials[scene.shades[element]];
  const of = (field) => Array.from({ length: bands }, (_, k) => shown(field[element * bands + k]));
  const place = middleOf(scene, element).map((x, axis) => shown(x + scene.centre[axis], 5));
  const emitted = (k) => shown(material.emitted[k]);
  const all = Array.from({ length: bands }, (_, k) => k);
  const rows = [
    ["Element", [`${element} of ${scene.sizes.length}`]],
    ["Surface", [part?.file ? `${surface} of ${part.file}` : `${surface}`]],
    ["Material", [material.name || "none"]],
    ["Place", [place.join(", ")]],
    ["Area", [shown(scene.areas[element])]],
    ["Sum of form factors", [shown(scene.rows[element])]],
  ];
  if (scene.solved) {
    if (bands > 1 && bands <= 6) rows.push(["", all.map((k) => bandName(scene, k))]);
    const few = (numbers) => (bands <= 6 ? numbers : [...numbers.slice(0, 5), "…"]);
    rows.push(
      ["Radiosity B [W/m²]", few(of(scene.radiosity))],
      ["Irradiance H [W/m²]", few(of(scene.irradiance))],
      ["Emission E [W/m²]", few(all.map(emitted))],
      ["Reflectance ρ", few(all.map((k) => shown(material.rho[k])))],
    );
    if (scene.heat) rows.push(["Temperature [K]", [shown(temperature(scene.radiosity[element * bands]))]]);
  }
  $("numbers").replaceChildren(
    ...rows.map(([name, cells]) => {
      const row = document.createElement("tr");
      const head = document.createElement("th");
      head.scope = "row";
      head.textContent = name;
      row.append(head);
      cells.forEach((text) => {
        const cell = document.createElement("td");
        if (cells.length === 1) cell.colSpan = 6;
        cell.textContent = text;
        row.append(cell);
      });
      return row;
    }),
  );
}

try {
  main();
} catch (error) {
  $("failure").textContent = error.message;
  $("failure").hidden = false;
  console.error(error);
}
