//! The patches of a chart that lies somewhere in a picture.

use serde::{Deserialize, Serialize};

use crate::cv;
use crate::error::Result;
use crate::median::median;
use crate::radiometry::hdr::HdrImage;

/// One patch of the chart in the picture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Patch {
    /// Centre, pixels.
    pub centre: [f64; 2],
    /// Median radiance R, G, B over the inner part of the patch.
    pub radiance: [f64; 3],
    /// Standard error of that median, from the scatter over the patch and the number of pixels.
    pub standard_error: [f64; 3],
    /// Median absolute deviation over the median, worst channel: texture, gloss or a stranger.
    pub unevenness: f64,
    /// Share of the pixels that no exposure measured within its range, worst channel.
    pub clipped: f64,
}

/// Share of clipped pixels from which a patch's median may be wrong.
const CLIPPED_SHARE: f64 = 0.05;

impl Patch {
    /// Whether the median may be too dark because pixels are clipped.
    pub fn is_clipped(&self) -> bool {
        self.clipped > CLIPPED_SHARE
    }
}

/// Where a chart lies: the plane map from its own unit to pixels. In that unit a patch is 2.5
/// wide, gaps and rim are 0.25, and (0, 0) is the rim's corner at dark skin.
pub(crate) struct Chart([f64; 9]);

/// Distance between the middles of neighbouring patches.
const PITCH: f64 = 2.75;

fn middle(patch: usize) -> [f64; 2] {
    [1.5 + PITCH * (patch % 6) as f64, 1.5 + PITCH * (patch / 6) as f64]
}

impl Chart {
    /// From the rim's corners: dark skin's, bluish green's, black's, white's.
    pub fn within(ring: [[f64; 2]; 4]) -> Result<Self> {
        let (wide, high) = (6.0 * PITCH + 0.25, 4.0 * PITCH + 0.25);
        let chart = [[0.0, 0.0], [wide, 0.0], [wide, high], [0.0, high]];
        Ok(Self(cv::homography(&chart, &ring)?))
    }

    /// From the middles of the corner patches in the same order.
    pub fn between(middles: [[f64; 2]; 4]) -> Result<Self> {
        Ok(Self(cv::homography(&[0, 5, 23, 18].map(middle), &middles)?))
    }

    fn pixel(&self, image: &HdrImage, place: [f64; 2]) -> Option<usize> {
        let [u, v] = cv::apply_homography(&self.0, place).map(f64::round);
        let inside = u >= 0.0 && v >= 0.0 && u < image.width as f64 && v < image.height as f64;
        inside.then(|| 3 * (v as usize * image.width + u as usize))
    }

    /// Medians of all patches.
    pub fn patches(&self, image: &HdrImage) -> [Patch; 24] {
        std::array::from_fn(|i| self.patch(image, i))
    }

    fn patch(&self, image: &HdrImage, number: usize) -> Patch {
        let middle = middle(number);
        let centre = cv::apply_homography(&self.0, middle);
        let corner = cv::apply_homography(&self.0, [middle[0] + 0.65, middle[1] + 0.65]);
        // The inner half of the patch, well away from its rim, about once a pixel.
        let across = (corner[0] - centre[0]).hypot(corner[1] - centre[1]) * 2.0_f64.sqrt();
        let steps = across.clamp(5.0, 60.0) as usize;
        let part = |k: usize| 1.3 * (k as f64 / (steps - 1) as f64 - 0.5);
        let mut values = [const { Vec::new() }; 3];
        let mut clipped = [0_usize; 3];
        for step in 0..steps * steps {
            let place = [middle[0] + part(step % steps), middle[1] + part(step / steps)];
            let Some(at) = self.pixel(image, place) else { continue };
            for c in 0..3 {
                values[c].push(f64::from(image.radiance[at + c]));
                clipped[c] +=
                    usize::from(image.variance.get(at + c).is_some_and(|v| v.is_infinite()));
            }
        }
        let mut patch = Patch {
            centre,
            radiance: [0.0; 3],
            standard_error: [0.0; 3],
            unevenness: 0.0,
            clipped: 0.0,
        };
        for (c, mut list) in values.into_iter().enumerate() {
            let n = list.len().max(1) as f64;
            let middle = median(&mut list).unwrap_or(f64::NAN);
            list.iter_mut().for_each(|v| *v = (*v - middle).abs());
            let deviation = median(&mut list).unwrap_or(f64::NAN);
            patch.radiance[c] = middle;
            // A normal sample's median scatters π/2 as much (in variance) as its mean; its
            // standard deviation is 1.4826 median absolute deviations.
            let sigma = 1.4826 * deviation;
            patch.standard_error[c] = sigma * (std::f64::consts::FRAC_PI_2 / n).sqrt();
            patch.unevenness = patch.unevenness.max(deviation / middle.abs().max(1e-12));
            patch.clipped = patch.clipped.max(clipped[c] as f64 / n);
        }
        patch
    }

    /// How bright the black lines between bright patches are over the darker patch beside them,
    /// in the median over the lines: near 0 in focus, towards 1 out of it.
    pub fn gaps_filled(&self, image: &HdrImage, patches: &[Patch; 24]) -> f64 {
        let green = |i: usize| patches[i].radiance[1];
        let brightest = (0..24).map(green).fold(0.0, f64::max);
        let mut filled = Vec::new();
        for i in (0..24).filter(|i| i % 6 < 5) {
            let beside = green(i).min(green(i + 1));
            // Dark patches are no brighter than the line.
            if beside < 0.15 * brightest {
                continue;
            }
            let [x, y] = middle(i);
            // The darkest place between the two, averaged along the line.
            let darkest = (-8..=8)
                .map(|step| {
                    let x = x + PITCH / 2.0 + 0.05 * f64::from(step);
                    let along: Vec<f64> = (-10..=10)
                        .filter_map(|s| self.pixel(image, [x, y + 0.08 * f64::from(s)]))
                        .map(|at| f64::from(image.radiance[at + 1]))
                        .collect();
                    along.iter().sum::<f64>() / along.len().max(1) as f64
                })
                .fold(f64::INFINITY, f64::min);
            filled.push(darkest / beside);
        }
        median(&mut filled).unwrap_or(f64::NAN)
    }
}
