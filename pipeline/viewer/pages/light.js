const at = (id) => document.getElementById(id);
const NO_ANSWER = { colour: "stop", sentence: "No connection: has hbm live ended?", rms: {} };

function element(name, text = "") {
  const made = document.createElement("div");
  made.className = name;
  made.textContent = text;
  return made;
}

function bar(rms, { axis, unit, limit, full }) {
  const row = element(rms > limit ? "bar beyond" : "bar"), scale = element("scale");
  const size = element("size"), line = element("limit");
  size.style.width = `${Math.min(100, (100 * rms) / full)}%`;
  line.style.left = `${(100 * limit) / full}%`;
  scale.append(size, line);
  row.append(element("axis", axis), scale, element("number", `${rms.toFixed(0)} ${unit}`));
  return row;
}

async function show() {
  let board = NO_ANSWER, scales = {};
  try {
    const answer = await fetch("board.json", { signal: AbortSignal.timeout(2000) });
    ({ board, ...scales } = await answer.json());
  } catch {}
  at("light").className = board.colour;
  for (const name of ["colour", "sentence", "done", "senders"]) at(name).textContent = board[name] ?? "";
  const best = Object.values(board.rms).at(-1) ?? [];
  const scale = (k) => ({
    axis: scales.axes[k], unit: scales.units[k], limit: scales.limits[k], full: scales.full[k],
  });
  at("bars").replaceChildren(...best.map((rms, k) => bar(rms, scale(k))));
  setTimeout(show, 500);
}
show();
