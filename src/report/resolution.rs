//! How far the images determine κ and μ: by depth, and slice by slice.

use crate::Failure;
use crate::report::bar::bar;
use crate::report::chart::{Line, logarithmic};
use crate::report::html::escape;
use crate::report::picture;
use crate::resolution::{ByDepth, ChannelByDepth};
use material::{Material, Resolution};

/// What is shown of one coefficient.
struct Shown {
    symbol: &'static str,
    key: &'static str,
    layers: fn(&ChannelByDepth) -> &[Option<f64>],
    voxels: fn(&Resolution) -> &[f32],
}

const SHOWN: [Shown; 2] = [
    Shown { symbol: "κ", key: "kappa", layers: |c| &c.kappa_mm, voxels: |r| &r.kappa_mm },
    Shown { symbol: "μ", key: "mu", layers: |c| &c.mu_mm, voxels: |r| &r.mu_mm },
];

/// Charts and slices; nothing for a material without a resolution. The slices belong to the slider
/// of `volumes.rs` and have its style.
pub(crate) fn resolution(material: &Material) -> Result<String, Failure> {
    let (Some(by_depth), Some(maps)) = (ByDepth::of(material), material.resolution()) else {
        return Ok(String::new());
    };
    let cells = material.grid().cells();
    let all = || maps.iter().flat_map(|r| r.kappa_mm.iter().chain(&r.mu_mm));
    let finite = || all().copied().filter(|v| v.is_finite()).map(f64::from);
    let low = finite().fold(f64::INFINITY, f64::min);
    let range =
        if low.is_finite() { [low, finite().fold(1.2 * low, f64::max)] } else { [0.1, 1.0] };
    let mut style = String::new();
    let mut out = "<h3>How far the images determine it</h3>\
        <p>The finest detail of κ and μ that the images say more about than the smoothness that was asked of \
        them, in mm: what is finer was filled in smoothly from around it. Grey: no detail up to the block's shortest \
        edge is determined, though coarser changes and the mean may be. It is a lower bound, since voxels, and κ and μ, can also make up for each \
        other. Charts show the median of each slice; speckle in the maps, some 7 %, is the estimate's own.</p>"
        .to_owned();
    for shown in &SHOWN {
        let values: Vec<Vec<f64>> = by_depth
            .channels
            .iter()
            .map(|c| (shown.layers)(c).iter().map(|v| v.unwrap_or(f64::INFINITY)).collect())
            .collect();
        let lines: Vec<Line<'_>> = by_depth
            .channels
            .iter()
            .zip(&values)
            .enumerate()
            .map(|(i, (c, values))| Line {
                name: &c.channel,
                class: ["r", "g", "b"][i % 3],
                values,
            })
            .collect();
        // The median voxel of a slice.
        let chart = logarithmic(&lines, "slice, from the front face", "finest detail, mm");
        out += &format!(
            "<h3>Finest detail of {} that the images determine, mm</h3>{}<div class=\"volumes\">",
            shown.symbol,
            chart.unwrap_or_else(|| format!(
                "<p>None up to {:.2} mm, in the median of any slice.</p>",
                by_depth.largest_mm
            ))
        );
        for (n, (channel, map)) in by_depth.channels.iter().zip(maps).enumerate() {
            let class = format!("{}-resolution-{n}", shown.key);
            let uri = picture::slices(cells, (shown.voxels)(map), range)?;
            style += &format!(".{class}{{background-image:url({uri})}}");
            let name = escape(&channel.channel);
            out += &format!(
                "<figure><div class=\"slice {class}\" role=\"img\" aria-label=\"Finest detail of {} in channel {name}\">\
                 </div><figcaption>{name}</figcaption></figure>",
                shown.symbol
            );
        }
        out += &format!("</div>{}", bar(range, "mm"));
    }
    Ok(format!("<style>{style}</style>{out}"))
}
