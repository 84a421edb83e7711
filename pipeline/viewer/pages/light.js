const at = (id) => document.getElementById(id);
const MOST_LATE_S = 10;
let last = { board: { colour: "look", sentence: "Starting", rms: {} } };
let answered = Date.now();

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
  let doubt = {};
  try {
    const answer = await fetch("board.json", { signal: AbortSignal.timeout(2000) });
    last = await answer.json();
    answered = Date.now();
  } catch (error) {
    // a browser that draws a viewer slowly answers late; counts and bars of an ended session stay
    const late_s = (Date.now() - answered) / 1000;
    doubt = error.name === "TimeoutError" && late_s < MOST_LATE_S
      ? { colour: "look", sentence: `This page is ${late_s.toFixed(0)} s late` }
      : { colour: "stop", sentence: "No connection: has hbm live ended?" };
  }
  const { board: known, ...scales } = last, board = { ...known, ...doubt };
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
