//! κ and μ slice by slice.

use crate::Failure;
use crate::report::bar::bar;
use crate::report::html::escape;
use crate::report::picture;
use material::{Channel, Material};

/// One coefficient of all channels.
struct Coefficient {
    symbol: &'static str,
    key: &'static str,
    meaning: &'static str,
    unit: &'static str,
    of: fn(&Channel) -> &[f32],
}

const COEFFICIENTS: [Coefficient; 2] = [
    Coefficient {
        symbol: "κ",
        key: "kappa",
        meaning: "diffusion coefficient: how far light spreads",
        unit: "mm",
        of: |c| &c.kappa_mm,
    },
    Coefficient {
        symbol: "μ",
        key: "mu",
        meaning: "absorption",
        unit: "1/mm",
        of: |c| &c.mu_per_mm,
    },
];

/// All but the outermost 0.5 % of the values on either side, and at least a factor of 1.2.
fn range(material: &Material, of: fn(&Channel) -> &[f32]) -> [f64; 2] {
    let mut all: Vec<f32> =
        material.channels().iter().flat_map(of).copied().filter(|v| *v > 0.0).collect();
    all.sort_unstable_by(f32::total_cmp);
    let at =
        |share: f64| all.get(((all.len() as f64 - 1.0) * share) as usize).map(|v| f64::from(*v));
    let (Some(low), Some(high)) = (at(0.005), at(0.995)) else { return [0.1, 1.0] };
    let widen = (1.2 * low / high).max(1.0).sqrt();
    [low / widen, high * widen]
}

/// The slices of both coefficients in every channel, with a slider through the depth.
pub(crate) fn volumes(material: &Material) -> Result<String, Failure> {
    let cells @ [_, _, nz] = material.grid().cells();
    let [w, h, _] = material.grid().size_mm();
    let depth = material.grid().spacing_mm()[2];
    let mut style = format!(
        "<style>.slice{{aspect-ratio:{w}/{h};--tall:{}%;background-position-y:50%}}",
        100 * nz
    );
    let mut out = format!(
        "<p>Slices from the front face (slice 1) to the back, colours by the logarithm. Each coefficient has one scale \
         for its channels.</p><div class=\"slider off\"><label for=\"depth\">depth</label>\
         <input id=\"depth\" type=\"range\" min=\"0\" max=\"{}\" value=\"{}\" data-mm=\"{depth}\">\
         <output id=\"depth-told\"></output></div>",
        nz.saturating_sub(1),
        nz / 2
    );
    for coefficient in &COEFFICIENTS {
        let range = range(material, coefficient.of);
        out += &format!(
            "<h3>{} in {}, {}</h3><div class=\"volumes\">",
            coefficient.symbol, coefficient.unit, coefficient.meaning
        );
        let mut strips = String::new();
        for (n, channel) in material.channels().iter().enumerate() {
            let class = format!("{}-{n}", coefficient.key);
            let uri = picture::slices(cells, (coefficient.of)(channel), range)?;
            style += &format!(".{class}{{background-image:url({uri})}}");
            let name = escape(&channel.name);
            out += &format!(
                "<figure><div class=\"slice {class}\" role=\"img\" aria-label=\"{} of channel {name}\"></div>\
                 <figcaption>{name}</figcaption></figure>",
                coefficient.symbol
            );
            strips += &format!(
                "<p class=\"note\">{} of {name}</p><div class=\"strip\">",
                coefficient.symbol
            );
            for z in 0..nz {
                let at = 100.0 * z as f64 / (nz.max(2) - 1) as f64;
                strips += &format!(
                    "<figure><div class=\"slice {class}\" style=\"background-position-y:{at:.3}%\"></div>\
                     <figcaption>{:.2} mm</figcaption></figure>",
                    (z as f64 + 0.5) * depth
                );
            }
            strips += "</div>";
        }
        out += &format!(
            "</div>{}<details><summary>all slices of {}</summary>{strips}</details>",
            bar(range, coefficient.unit),
            coefficient.symbol
        );
    }
    Ok(style + "</style>" + &out)
}
