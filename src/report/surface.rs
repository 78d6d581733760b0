//! What the surface reflects by itself.

use crate::Failure;
use crate::commands::solve::Convergence;
use crate::commands::verify::Verification;
use crate::report::bar::even_bar;
use crate::report::html::{capital, escape};
use crate::report::picture;
use material::{BoundaryConvention, Material};

/// A map a channel on one scale, and what it is good for; None for a material without a surface. The
/// pictures have the style of the slices of `volumes.rs`.
pub(crate) fn surface(
    material: &Material,
    converged: Option<&Convergence>,
    checked: Option<&Verification>,
) -> Result<Option<String>, Failure> {
    let Some(maps) = material.surface() else { return Ok(None) };
    let [nx, ny, _] = material.grid().cells();
    let [w, h, _] = material.grid().size_mm();
    let mut sorted: Vec<f64> =
        maps.iter().flat_map(|m| &m.reflectance).map(|rho| f64::from(*rho)).collect();
    // The brightest 0.5 % may be glints.
    sorted.sort_unstable_by(f64::total_cmp);
    let high = sorted[(sorted.len() as f64 * 0.995) as usize].max(1e-4);
    let once = match material.optics().boundary {
        BoundaryConvention::Transport => "",
        _ => {
            " Light that scattered once is taken from κ and μ of the outermost cells and added too."
        }
    };
    let mut out = format!(
        "<p>Light that never went in: how much of it the surface reflects diffusely by itself, 1 being a white sheet. It \
         is what the material leaves unexplained in the picture with light on all of the face, what the model gets wrong \
         next to light among it, and is added where light falls.{once}</p>"
    );
    if let Some(lit) = checked.and_then(|v| v.lit_pixels.as_ref()) {
        out += &format!(
            "<p>Pixels that are lit directly are explained to {:.1} % relative RMS, without the surface to {:.1} %.</p>",
            100.0 * lit.rel_rms,
            100.0 * lit.without_surface_rel_rms
        );
    }
    let warnings = converged.iter().flat_map(|c| &c.surface).filter_map(|s| s.warning());
    warnings.for_each(|warning| out += &format!("<p>{}.</p>", escape(capital(&warning))));
    out += "<div class=\"volumes\">";
    for (channel, map) in material.channels().iter().zip(maps) {
        let places: Vec<f64> = map.reflectance.iter().map(|rho| f64::from(*rho) / high).collect();
        let uri = picture::shares([nx, ny], &places)?;
        let name = escape(&channel.name);
        out += &format!(
            "<figure><img src=\"{uri}\" alt=\"surface reflectance of channel {name}\" \
             style=\"aspect-ratio:{w}/{h};width:100%;image-rendering:pixelated\"><figcaption>{name}</figcaption></figure>"
        );
    }
    Ok(Some(format!("{out}</div>{}", even_bar(high, ""))))
}
