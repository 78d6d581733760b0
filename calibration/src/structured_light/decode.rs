//! From the pictures of a code sequence to projector columns and rows.

use rayon::prelude::*;

use crate::error::Result;
use crate::photo::Photo;
use crate::structured_light::check::check_sequence;
use crate::structured_light::classify::{Separation, grey_row};
use crate::structured_light::layout::CodeLayout;
use crate::structured_light::phase;
use crate::structured_light::steps::{StepMap, step};

/// Which projector pixel lights each pixel of the camera.
#[derive(Clone, Debug)]
pub struct Decoded {
    /// Camera pixels a row.
    pub width: usize,
    /// Rows of the camera's picture.
    pub height: usize,
    /// Projector columns.
    pub columns: CodeMap,
    /// Projector rows.
    pub rows: CodeMap,
}

/// A projector coordinate for each camera pixel, row by row.
#[derive(Clone, Debug)]
pub struct CodeMap {
    /// Projector pixels, the centre of the first at 0. NaN where the code could not be decided:
    /// unlit, too dark, or more lit by way of other points than by the projector itself. Whole
    /// numbers without phase shift.
    pub position: Vec<f32>,
    /// 1-sigma of the position, projector pixels: from the sinusoid's modulation and the
    /// pictures' noise; without phase shift that of a number rounded to a whole.
    pub sigma: Vec<f32>,
    /// Where the code steps from one column (row) to the next, between camera pixels.
    pub(crate) steps: StepMap,
}

impl Decoded {
    /// Share of the camera's pixels that have a projector pixel.
    pub fn share(&self) -> f64 {
        let both = self.columns.position.iter().zip(&self.rows.position);
        let decided = both.filter(|(c, r)| c.is_finite() && r.is_finite()).count();
        decided as f64 / (self.width * self.height).max(1) as f64
    }
}

/// No code.
pub(crate) const UNDECIDED: u16 = u16::MAX;
/// Rows that one task decodes.
const BAND: usize = 16;
/// Gray code bits whose stripes separate direct from indirect light: 4 to 16 stripe widths of
/// the finest, narrow against the way that light travels below a surface or between objects, wide
/// against the blur.
pub(crate) const SEPARATING_BITS: std::ops::RangeInclusive<u32> = 1..=3;
/// Differences below this many standard deviations say nothing.
const NOISE_SIGMAS: f64 = 3.0;

/// Decodes a sequence of pictures, in the order of [`CodeLayout::sequence`].
///
/// A bit of a pixel is decided only where direct and indirect light leave no doubt (Nayar et al.
/// 2006; Xu & Aliaga 2007) and the difference to the inverse stands out of the pictures' own
/// noise; a pixel keeps its code with one bit in doubt if both answers name neighbouring columns,
/// as they do on the edge between them. Sinusoids, where the layout has them, are unwrapped by
/// that code.
///
/// # Errors
/// Pictures that are too few or too many, of different sizes, exchanged, or shown twice: named.
pub fn decode(layout: &CodeLayout, pictures: &[Photo]) -> Result<Decoded> {
    let noise = check_sequence(layout, pictures)?;
    let (width, height) = pictures.first().map_or((0, 0), |p| (p.width, p.height));
    let reader = Reader { layout, pictures, width, noise: noise_floor(noise) };
    let empty = || CodeMap {
        position: vec![f32::NAN; width * height],
        sigma: vec![f32::NAN; width * height],
        steps: StepMap::new(width * height),
    };
    let [mut columns, mut rows] = [empty(), empty()];
    let band = BAND * width.max(1);
    columns.bands(band).zip(rows.bands(band)).enumerate().for_each(
        |(i, (mut columns, mut rows))| {
            let first = i * BAND;
            let rows_here = columns.position.len() / width.max(1);
            let mut here = reader.row(first);
            for y in 0..rows_here {
                // The steps to the row below need that row, though it be the next band's.
                let below = (first + y + 1 < height).then(|| reader.row(first + y + 1));
                columns.write(0, y, &here, below.as_ref());
                rows.write(1, y, &here, below.as_ref());
                if layout.phase().is_some() {
                    let at = y * width..(y + 1) * width;
                    for (axis, map) in [(0, &mut columns), (1, &mut rows)] {
                        let (position, sigma) =
                            (&mut map.position[at.clone()], &mut map.sigma[at.clone()]);
                        phase::refine(layout, pictures, axis, first + y, noise, position, sigma);
                    }
                }
                if let Some(below) = below {
                    here = below;
                }
            }
        },
    );
    Ok(Decoded { width, height, columns, rows })
}

/// The least difference between a picture and its inverse that means anything, codes.
fn noise_floor(noise: f64) -> i32 {
    ((NOISE_SIGMAS * noise).ceil() as i32).max(2)
}

/// A band of rows of a map, for one task.
struct Band<'a> {
    position: &'a mut [f32],
    sigma: &'a mut [f32],
    right: &'a mut [u8],
    down: &'a mut [u8],
}

impl CodeMap {
    fn bands(&mut self, band: usize) -> impl IndexedParallelIterator<Item = Band<'_>> {
        self.position
            .par_chunks_mut(band)
            .zip(self.sigma.par_chunks_mut(band))
            .zip(self.steps.right.par_chunks_mut(band))
            .zip(self.steps.down.par_chunks_mut(band))
            .map(|(((position, sigma), right), down)| Band { position, sigma, right, down })
    }
}

impl Band<'_> {
    fn write(&mut self, axis: usize, y: usize, here: &Row, below: Option<&Row>) {
        let width = here.contrast.len();
        // A number rounded to a multiple of w lies within w/√12 of it, one sigma.
        let sigma = here.stripe_px / 12_f32.sqrt();
        for x in 0..width {
            let code = here.codes[axis][x];
            if code == UNDECIDED {
                continue;
            }
            let at = y * width + x;
            // The middle of the stripe's pixels.
            self.position[at] = (f32::from(code) + 0.5) * here.stripe_px - 0.5;
            self.sigma[at] = sigma;
            // A phase says more than the edges of coarse stripes.
            if here.with_phase {
                continue;
            }
            if x + 1 < width {
                self.right[at] = step(here.sample(axis, x), here.sample(axis, x + 1));
            }
            if let Some(below) = below {
                self.down[at] = step(here.sample(axis, x), below.sample(axis, x));
            }
        }
    }
}

/// What the bits of one row of the camera's picture say.
pub(crate) struct Row {
    /// Stripe number along each axis, or [`UNDECIDED`].
    codes: [Vec<u16>; 2],
    /// Picture and inverse of each bit of each axis, finest first.
    pairs: [Vec<[Vec<i32>; 2]>; 2],
    /// White minus black.
    contrast: Vec<i32>,
    stripe_px: f32,
    with_phase: bool,
}

/// One pixel's code, and its differences by bit.
#[derive(Clone, Copy)]
pub(crate) struct Sample<'a> {
    pub(crate) code: u16,
    row: &'a Row,
    axis: usize,
    x: usize,
}

impl Sample<'_> {
    /// Picture minus inverse over white minus black.
    pub(crate) fn relative_difference(&self, bit: u32) -> f32 {
        let pair = self.row.pairs[self.axis].get(bit as usize);
        let difference = pair.map_or(0, |[p, q]| p[self.x] - q[self.x]);
        difference as f32 / self.row.contrast[self.x].max(1) as f32
    }
}

impl Row {
    fn sample(&self, axis: usize, x: usize) -> Sample<'_> {
        Sample { code: self.codes[axis][x], row: self, axis, x }
    }
}

struct Reader<'a> {
    layout: &'a CodeLayout,
    pictures: &'a [Photo],
    width: usize,
    noise: i32,
}

impl Reader<'_> {
    fn row(&self, y: usize) -> Row {
        let (layout, width) = (self.layout, self.width);
        let read = |at: usize| {
            let mut row = vec![0_i32; width];
            if let Some(photo) = self.pictures.get(at) {
                grey_row(photo, y, &mut row);
            }
            row
        };
        let [white, black] = layout.white_black_at().map(read);
        let pairs: [Vec<[Vec<i32>; 2]>; 2] = [0, 1].map(|axis| {
            let at = |bit| layout.bit_at(axis, bit);
            (0..layout.bits(axis)).map(|bit| [read(at(bit)), read(at(bit) + 1)]).collect()
        });
        let contrast: Vec<i32> = white.iter().zip(&black).map(|(w, b)| w - b).collect();
        let light = separate(&pairs, &black);
        let codes = [0, 1].map(|axis| {
            let stripes = layout.projector[axis].div_ceil(layout.stripe_px());
            let bits = read_bits(&pairs[axis], &light, self.noise);
            let decide = |((gray, doubts), &contrast): ((u32, u32), &i32)| {
                let lit = contrast >= self.noise;
                lit.then(|| stripe(gray, doubts, stripes)).flatten().unwrap_or(UNDECIDED)
            };
            bits.into_iter().zip(&contrast).map(decide).collect()
        });
        let stripe_px = layout.stripe_px() as f32;
        Row { codes, pairs, contrast, stripe_px, with_phase: layout.phase().is_some() }
    }
}

/// Direct and indirect light of each pixel of a row.
fn separate(pairs: &[Vec<[Vec<i32>; 2]>; 2], black: &[i32]) -> Vec<Separation> {
    let mut brightest = vec![0; black.len()];
    let mut darkest = vec![i32::MAX; black.len()];
    for pairs in pairs {
        let last = pairs.len().saturating_sub(1);
        let [from, to] = [SEPARATING_BITS.start(), SEPARATING_BITS.end()].map(|b| *b as usize);
        for row in pairs[from.min(last)..=to.min(last)].iter().flatten() {
            brightest.iter_mut().zip(row).for_each(|(b, &v)| *b = v.max(*b));
            darkest.iter_mut().zip(row).for_each(|(d, &v)| *d = v.min(*d));
        }
    }
    let extremes = brightest.iter().zip(&darkest).zip(black);
    extremes.map(|((&b, &d), &black)| Separation::new(b, d, black)).collect()
}

/// Gray code of each pixel of a row, and which of its bits are in doubt.
fn read_bits(pairs: &[[Vec<i32>; 2]], light: &[Separation], noise: i32) -> Vec<(u32, u32)> {
    let mut out = vec![(0, 0); light.len()];
    for (bit, [pattern, inverse]) in pairs.iter().enumerate() {
        let pixels = pattern.iter().zip(inverse).zip(light);
        for ((gray, doubts), ((&p, &q), light)) in out.iter_mut().zip(pixels) {
            *gray |= u32::from(p > q) << bit;
            *doubts |= u32::from(light.in_doubt(p - q, noise)) << bit;
        }
    }
    out
}

/// The stripe of a Gray code. One bit may be in doubt if its two answers name neighbours.
fn stripe(gray: u32, doubts: u32, stripes: usize) -> Option<u16> {
    let code = gray_to_binary(gray);
    let decided = match doubts.count_ones() {
        0 => true,
        1 => gray_to_binary(gray ^ doubts).abs_diff(code) == 1,
        _ => false,
    };
    (decided && (code as usize) < stripes).then(|| u16::try_from(code).ok()).flatten()
}

pub(crate) fn gray_to_binary(gray: u32) -> u32 {
    [1, 2, 4, 8, 16].iter().fold(gray, |code, shift| code ^ (code >> shift))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_bit_in_doubt_between_neighbours_is_no_harm() {
        let read = |code: u32, doubts: u32| stripe(code ^ (code >> 1), doubts, 1000);
        for code in 0..1000 {
            assert_eq!(read(code, 0), Some(code as u16));
            assert_eq!(read(code, 1), Some(code as u16));
            assert_eq!(read(code, 3), None);
        }
        // 511 and 512 differ in the coarsest bit alone; 300 and its reflection are far apart.
        assert_eq!(read(511, 1 << 9), Some(511));
        assert_eq!(read(300, 1 << 9), None);
        assert_eq!(read(1001, 0), None);
    }
}
