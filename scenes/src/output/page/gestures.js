// What mouse, fingers and keys do to the camera.

/** How far a drag across the whole picture turns, in radians. */
const TURN = 3;
/** How far one walks in a second, relative to the scene. */
const PACE = 0.45;

/** Whether a key is meant for the scene: not for a control that has the focus, nor for the browser. */
function isForScene(event) {
  const taken = event.ctrlKey || event.metaKey || event.altKey;
  return !taken && !event.target.closest?.("input, select, button, summary, a");
}

/**
 * Lets a canvas' events move a camera. `changed` is called after every change, `pointed` with the place that the
 * pointer is over, or null, `centred` with a place that was clicked twice.
 */
function listen(canvas, camera, { changed, pointed, centred }) {
  const pointers = new Map();
  const held = new Set();
  let latest = 0;

  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  // A length in the scene that looks as long as a pixel where the camera turns around.
  const pixel = () => {
    const short = Math.min(canvas.clientWidth, canvas.clientHeight);
    return (camera.scene.camera.film * camera.distance) / short;
  };
  const turn = (dx, dy) => {
    const angle = TURN / Math.max(canvas.clientWidth, canvas.clientHeight);
    // Who orbits turns the scene along with the pointer; who walks turns the head the other way.
    const sign = camera.walks ? -0.6 : 1;
    camera.turn(sign * angle * dx, -sign * angle * dy);
  };

  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, place(event));
    canvas.focus({ preventScroll: true });
  });
  for (const name of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(name, (event) => pointers.delete(event.pointerId));
  }
  canvas.addEventListener("pointerleave", () => pointed(null));
  canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    const now = place(event);
    if (!before) {
      pointed(now);
      return;
    }
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    if (pointers.size === 1) {
      if (event.buttons & 6 || event.ctrlKey) camera.shift(-dx * pixel(), dy * pixel());
      else turn(dx, dy);
    } else {
      // Both fingers share the way: each shifts by half, and the distance between them counts.
      const [other] = [...pointers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
      const gap = (at) => Math.max(1, Math.hypot(at[0] - other[0], at[1] - other[1]));
      camera.zoom(gap(now) / gap(before));
      camera.shift(-0.5 * dx * pixel(), 0.5 * dy * pixel());
    }
    pointers.set(event.pointerId, now);
    changed();
  });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("dblclick", (event) => centred(place(event)));
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const lines = event.deltaMode === 1 ? 16 : 1;
      camera.zoom(Math.exp(-0.0015 * lines * event.deltaY));
      changed();
    },
    { passive: false },
  );

  const TURNS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  const STEPS = {
    KeyA: [-1, 0, 0],
    KeyD: [1, 0, 0],
    KeyQ: [0, -1, 0],
    KeyE: [0, 1, 0],
    KeyS: [0, 0, -1],
    KeyW: [0, 0, 1],
  };
  window.addEventListener("keydown", (event) => {
    if (!isForScene(event)) return;
    if (event.code in TURNS) {
      const [right, upwards] = TURNS[event.code];
      camera.turn(0.06 * right, 0.06 * upwards);
      changed();
      event.preventDefault();
    } else if (event.key === "+" || event.key === "-") {
      camera.zoom(event.key === "+" ? 1.1 : 1 / 1.1);
      changed();
    } else if (event.code in STEPS) {
      if (held.size === 0) {
        latest = performance.now();
        requestAnimationFrame(step);
      }
      held.add(event.code);
    }
    held.fast = event.shiftKey;
  });
  window.addEventListener("keyup", (event) => held.delete(event.code));
  window.addEventListener("blur", () => held.clear());

  // Moves as long as keys are held.
  function step(now) {
    if (held.size === 0) return;
    const seconds = Math.min(0.1, Math.max(0, now - latest) / 1000);
    latest = now;
    const length = PACE * camera.scene.radius * seconds * (held.fast ? 3 : 1);
    for (const code of held) camera.move(...STEPS[code].map((x) => x * length));
    changed();
    requestAnimationFrame(step);
  }
}
