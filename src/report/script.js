// One slider moves all volumes to the same depth; without a script the middle slice stays.
const slider = document.getElementById("depth");
if (slider) {
  const told = document.getElementById("depth-told");
  const slices = document.querySelectorAll(".volumes .slice");
  const show = () => {
    const z = Number(slider.value), all = Number(slider.max);
    slices.forEach(s => { s.style.backgroundPositionY = `${(100 * z) / all}%`; });
    const depth = (z + 0.5) * Number(slider.dataset.mm);
    told.textContent = `slice ${z + 1} of ${all + 1}, ${depth.toFixed(2)} mm deep`;
  };
  slider.addEventListener("input", show);
  slider.closest(".slider").classList.remove("off");
  show();
}
// Paper shows every slice, but no lists of hashes that go on for pages.
addEventListener("beforeprint", () => document.querySelectorAll("details:not(.long)").forEach(d => { d.open = true; }));
