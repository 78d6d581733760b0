// Opens each page in frames as wide as a phone and a desktop, and notes what is wrong with it.
// PAGES and WIDTHS come before; the outcome stands in #outcome as JSON.
const outcome = document.getElementById("outcome");

const loads = (address) => new Promise((resolve) => {
  const image = new Image();
  image.onload = () => resolve(image.naturalWidth > 0);
  image.onerror = () => resolve(false);
  image.src = address;
});

async function look(page, width) {
  const frame = document.createElement("iframe");
  frame.style = `border: 0; width: ${width}px; height: 900px`;
  const loaded = new Promise((resolve) => { frame.onload = resolve; });
  frame.src = page;
  document.body.append(frame);
  await loaded;
  const seen = frame.contentDocument, view = frame.contentWindow;
  seen.querySelectorAll("details").forEach((d) => { d.open = true; });
  const found = { page, width, scrolls: seen.documentElement.scrollWidth };
  // Who sticks out, to have a name for it; what scrolls by itself may.
  found.wide = [...seen.querySelectorAll("main *")]
    .filter((e) => e.getBoundingClientRect().right > width + 0.5 && !e.closest(".wide, pre, svg"))
    .slice(0, 3).map((e) => e.outerHTML.slice(0, 120));

  const addresses = [...seen.images].map((i) => i.src);
  seen.querySelectorAll("svg image").forEach((i) => addresses.push(i.href.baseVal));
  const slices = [...seen.querySelectorAll(".slice")];
  const behind = slices.map((s) => view.getComputedStyle(s).backgroundImage.slice(5, -2));
  const all = [...new Set([...addresses, ...behind])];
  const there = await Promise.all(all.map(loads));
  found.images = all.length;
  found.missing = all.filter((_, i) => !there[i]).map((a) => a.slice(0, 60));
  found.outside = all.filter((a) => !a.startsWith("data:"));
  // A picture that takes no place is not seen.
  found.flat = [...seen.images, ...slices].filter((e) => e.getBoundingClientRect().height < 1).length;

  const slider = seen.getElementById("depth");
  if (slider) {
    const shown = seen.querySelector(".volumes .slice");
    const at = (z) => {
      slider.value = z;
      slider.dispatchEvent(new view.Event("input"));
      return [view.getComputedStyle(shown).backgroundPositionY, seen.getElementById("depth-told").textContent];
    };
    found.slider = { max: Number(slider.max), first: at(0), last: at(slider.max), height: slider.getBoundingClientRect().height };
  }
  frame.remove();
  return found;
}

(async () => {
  const all = [];
  for (const page of PAGES) for (const width of WIDTHS) all.push(await look(page, width));
  outcome.textContent = JSON.stringify(all);
})().catch((e) => { outcome.textContent = JSON.stringify({ failed: String(e) }); });
