const here = window.fetch.bind(window);
window.fetch = (asked, ...more) =>
  new URL(asked.url ?? asked, location).origin === location.origin
    ? here(asked, ...more)
    : Promise.resolve(new Response());
async function start() {
  await wasm_bindgen({ module_or_path: "re_viewer_bg.wasm" });
  window.viewer = new wasm_bindgen.WebHandle({
    url: [new URL("recording.rrd", location.origin).href],
    render_backend: new URLSearchParams(location.search).get("renderer"),
    hide_welcome_screen: true,
    check_for_updates_on_startup: false,
    persist: false,
  });
  await window.viewer.start(document.getElementById("canvas"));
}
start().catch((error) => {
  document.getElementById("canvas").remove();
  document.getElementById("state").textContent = `The viewer did not start: ${error}`;
});
