//! What a response is recovered from: the same pixels as several exposures see them.

use std::ops::Range;

use rayon::prelude::*;

use crate::photo::Photo;
use crate::radiometry::response::KNOTS;

/// Pixels taken for each of 256 codes, over all pictures: enough to average noise, few enough
/// for dark corners to count as much as the sky.
const PIXELS_PER_CODE: usize = 600;

/// One exposure's view of one pixel.
pub(crate) struct Sight {
    /// ln of its exposure time, s.
    pub log_time: f64,
    /// The knot at or below its code.
    knot: u32,
    /// How far the code is on the way to the next knot.
    share: f32,
    /// By where its code stands in the range.
    pub trust: f32,
    /// Trust, less if the sight disagrees with its pixel's others.
    pub weight: f32,
}

impl Sight {
    /// The knots around its code and the code's share in each. Where codes are knots, as with
    /// 8 bits, the first has all.
    pub fn knots(&self) -> impl Iterator<Item = (usize, f64)> {
        let (k, share) = (self.knot as usize, f64::from(self.share));
        [(k, 1.0 - share), (k + 1, share)].into_iter().filter(|(_, share)| *share > 0.0)
    }
}

/// The chosen pixels that at least two exposures see: one pixel's sights after the other's, as
/// there are too many pixels for each to have memory of its own.
pub(crate) struct Pixels {
    pub sights: Vec<Sight>,
    ends: Vec<usize>,
}

impl Pixels {
    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// Where the sights of each pixel lie.
    pub fn ranges(&self) -> impl Iterator<Item = Range<usize>> {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(start, end)| start..*end)
    }
}

/// Chooses pixels of one channel and looks at them in every exposure of the bracket.
pub(crate) fn look(bracket: &[(Photo, f64)], channel: usize) -> Pixels {
    let logs: Vec<f64> = bracket.iter().map(|(_, time)| time.ln()).collect();
    let mut pixels = Pixels { sights: Vec::new(), ends: Vec::new() };
    for pixel in choose_pixels(bracket, channel) {
        let start = pixels.sights.len();
        pixels.sights.extend(bracket.iter().zip(&logs).filter_map(|((photo, _), &log_time)| {
            let code = f64::from(photo.data[pixel * photo.channels + channel]);
            let full = f64::from(photo.max_value);
            let trust = hat(code / full) as f32;
            let position = code * (KNOTS - 1) as f64 / full;
            let knot = (position as usize).min(KNOTS - 2);
            let share = (position - knot as f64) as f32;
            let sight = Sight { log_time, knot: knot as u32, share, trust, weight: trust };
            (trust > 0.0).then_some(sight)
        }));
        if pixels.sights.len() - start > 1 {
            pixels.ends.push(pixels.sights.len());
        } else {
            pixels.sights.truncate(start);
        }
    }
    pixels
}

/// Debevec's hat: trusts the middle of the range, ignores the ends.
fn hat(code: f64) -> f64 {
    // Within 2 % of either end clipping has eaten half of the noise.
    if (0.02..=0.98).contains(&code) { code.min(1.0 - code) } else { 0.0 }
}

/// For each code of each picture the pixels with the least going on around them: away from
/// edges, where a shake of the camera or blooming would mix exposures.
fn choose_pixels(bracket: &[(Photo, f64)], channel: usize) -> Vec<usize> {
    let each = PIXELS_PER_CODE.div_ceil(bracket.len());
    let quiet = bracket.par_iter().map(|(photo, _)| quiet_pixels(photo, channel, each));
    let mut chosen = quiet.collect::<Vec<_>>().concat();
    chosen.sort_unstable();
    chosen.dedup();
    chosen
}

/// At most `each` pixels of every code.
fn quiet_pixels(photo: &Photo, channel: usize, each: usize) -> Vec<usize> {
    let (width, n) = (photo.width, photo.channels);
    // A few hundred thousand looked at in any picture is plenty.
    let stride = (photo.width * photo.height / 200_000).max(1);
    let code = |pixel: usize| i32::from(photo.data[pixel * n + channel]);
    let mut by_code: Vec<Vec<(i32, usize)>> = vec![Vec::new(); KNOTS];
    for y in 1..photo.height.saturating_sub(1) {
        for x in (1 + y % stride..width.saturating_sub(1)).step_by(stride) {
            let at = y * width + x;
            let around = [at - 1, at + 1, at - width, at + width, at - width - 1, at + width + 1];
            let unrest = around.iter().map(|&p| (code(p) - code(at)).abs()).sum();
            let bin = code(at) as usize * (KNOTS - 1) / usize::from(photo.max_value);
            by_code[bin].push((unrest, at));
        }
    }
    let mut quiet = Vec::new();
    for mut pixels in by_code {
        if pixels.len() > each {
            pixels.select_nth_unstable(each);
            pixels.truncate(each);
        }
        quiet.extend(pixels.into_iter().map(|(_, at)| at));
    }
    quiet
}
