//! How far the images determine κ and μ: by depth, and slice by slice.

use crate::Failure;
use crate::report::bar::bar;
use crate::report::depths::depths;
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
    let largest = by_depth.largest_mm;
    let all = maps.iter().flat_map(|r| r.kappa_mm.iter().chain(&r.mu_mm));
    let finest = all.map(|v| f64::from(*v)).fold(largest, f64::min);
    // One scale for both coefficients.
    let range = [finest.min(largest / 1.2), largest];
    let mut style = String::new();
    let mut out = format!(
        "<h3>How far the images determine κ and μ</h3>\
         <p>How small a detail can be for the images to tell it: the smaller, the better. What is finer was filled in \
         smoothly from around it. Where nothing up to {largest:.2} mm is told, half the block's longest edge, trust \
         the mean level alone. This is an estimate, good to about 15 %, and rather too fine than too coarse. Lines are \
         medians of slices; the slider above moves the maps too.</p>"
    );
    for shown in &SHOWN {
        let layers: Vec<&[Option<f64>]> = by_depth.channels.iter().map(shown.layers).collect();
        out += &format!("<p><b>{}</b>: {}</p>", shown.symbol, in_words(&by_depth, &layers));
        let told = |map: &Resolution| (shown.voxels)(map).iter().any(|v| v.is_finite());
        if !maps.iter().any(told) {
            continue;
        }
        out += &format!(
            "{}<p class=\"note\">finest detail of {}; grey: not determined</p><div class=\"volumes\">",
            depths(&by_depth, &layers),
            shown.symbol
        );
        for (n, (channel, map)) in by_depth.channels.iter().zip(maps).enumerate() {
            let class = format!("{}-resolution-{n}", shown.key);
            let uri = picture::slices(material.grid().cells(), (shown.voxels)(map), range)?;
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

/// What a chart says, in a sentence or two.
fn in_words(by_depth: &ByDepth, layers: &[&[Option<f64>]]) -> String {
    let best = |values: &&[Option<f64>]| values.iter().flatten().copied().reduce(f64::min);
    let best: Vec<Option<f64>> = layers.iter().map(best).collect();
    let Some(finest) = best.iter().flatten().copied().reduce(f64::min) else {
        return "in no channel do the images determine any detail, in the median of any slice. Take its maps for \
                their mean level."
            .to_owned();
    };
    let channels = by_depth.channels.iter().zip(&best).map(|(channel, best)| {
        let name = escape(&channel.channel);
        match best {
            Some(mm) => format!("in {name} from {mm:.1} mm on"),
            None => format!("in {name} not at all"),
        }
    });
    let channels: Vec<String> = channels.collect();
    let depth = if finest > by_depth.thickness_mm {
        format!(
            " That is more than the block is thick ({:.1} mm): where on the face something lies is determined, at \
             what depth it lies is not.",
            by_depth.thickness_mm
        )
    } else {
        String::new()
    };
    format!("detail is determined {}, in the slice where it is finest.{depth}", channels.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chart_is_put_into_words() {
        let channel = |name: &str| ChannelByDepth {
            channel: name.into(),
            kappa_mm: Vec::new(),
            mu_mm: Vec::new(),
        };
        let by_depth = ByDepth {
            depth_mm: vec![0.5, 1.5],
            thickness_mm: 2.0,
            largest_mm: 8.0,
            channels: vec![channel("R"), channel("G")],
        };
        let none = [None; 2];
        let words = |first: [Option<f64>; 2]| in_words(&by_depth, &[&first, &none]);
        assert!(words(none).contains("no channel"));
        let fine = words([None, Some(1.26)]);
        assert!(fine.contains("in R from 1.3 mm on, in G not at all"), "{fine}");
        assert!(!fine.contains("thick"), "{fine}");
        assert!(words([Some(3.0), Some(2.5)]).contains("thick (2.0 mm)"));
    }
}
