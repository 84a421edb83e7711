const here = window.fetch.bind(window);
window.fetch = (asked, ...more) =>
  new URL(asked.url ?? asked, location).origin === location.origin
    ? here(asked, ...more)
    : Promise.resolve(new Response());
// Protocol Buffers of the viewer's request to pause at a cursor
function pausing([timeline, value]) {
  const field = (tag, content) => [tag, content.length, ...content];
  const moment = [0x08];
  let rest = BigInt.asUintN(64, BigInt(value));
  for (; rest > 127n; rest >>= 7n) moment.push(Number(rest & 127n) | 128);
  const name = [...new TextEncoder().encode(timeline)];
  const time = field(0x1a, [...moment, Number(rest)]);
  return field(0x32, [...field(0x12, field(0x0a, name)), ...time, 0x28, 1]);
}
const asked = new URLSearchParams(location.search);  // links of pages name a trial and an instant
if (LIGHT) Object.assign(document.getElementById("light"), { src: "light", hidden: false });
async function start() {
  await wasm_bindgen({ module_or_path: "re_viewer_bg.wasm" });
  window.viewer = new wasm_bindgen.WebHandle({
    url: [new URL(`${encodeURIComponent(asked.get("trial") || "recording")}.rrd`, location.origin).href],
    render_backend: asked.get("renderer"),
    hide_welcome_screen: true,
    check_for_updates_on_startup: false,
    persist: false,
  });
  await window.viewer.start(document.getElementById("canvas"));
  const cursor = asked.has("at") ? ["time", Math.round(1e9 * asked.get("at"))] : CURSOR;
  while (cursor)
    try {
      await window.viewer.viewer_control(new Uint8Array(pausing(cursor)));
      break;
    } catch {  // the recording has not come yet
      await new Promise((later) => setTimeout(later, 100));
    }
}
start().catch((error) => {
  document.getElementById("canvas").remove();
  document.getElementById("state").textContent = `The viewer did not start: ${error}`;
});
