//! Lines of pixels through all pictures of a sequence, to judge the sequence by.

use rayon::prelude::*;

use crate::photo::Photo;
use crate::structured_light::classify::{Separation, grey};
use crate::structured_light::decode::{SEPARATING_BITS, gray_to_binary};
use crate::structured_light::layout::CodeLayout;

/// Lines through the picture in each direction.
const LINES: usize = 16;
/// A pixel is lit by the projector if its brightest code exceeds its darkest by this share of the
/// most that any pixel's does.
const LIT: f64 = 0.1;
/// A relative brightness above 1 − this is lit beyond doubt, below this dark.
const CLEAR: f32 = 0.2;
/// A picture and its inverse are told apart if they differ by this share of a pixel's range, and
/// by so many of the noise's standard deviations: what blur leaves of the finest stripes.
const APART: f32 = 0.05;
const APART_SIGMAS: f64 = 4.0;
/// Share of the lit pixels where a bit that is of use can be told from its inverse.
const LEAST_APART: f64 = 0.3;
/// Ways that differ by less than this factor tell nothing: some pixels at the edges of the light.
const AS_SHORT: f64 = 1.1;

/// Grey codes on some lines of the camera's picture.
pub(crate) struct Samples {
    /// Bits of each axis.
    bits: [u32; 2],
    /// Place of each axis' coarsest bit.
    bit_at: [usize; 2],
    /// For each lit pixel: its code in each picture up to black, as a share from its darkest to
    /// its brightest.
    pub(crate) shares: Vec<Vec<f32>>,
    /// For each lit pixel the least share that a picture must differ from its inverse by.
    apart: Vec<f32>,
    /// Whether a lit pixel gets most of its light straight from the projector.
    direct: Vec<bool>,
    /// Which line a lit pixel is on; the even ones run along rows. Neighbours on a line follow
    /// each other.
    lines: Vec<usize>,
    /// Pictures up to black.
    pictures: usize,
    noise: f64,
}

/// How far a code goes along the lines, and the least that it could.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Way {
    pub(crate) length: f64,
    pub(crate) range: f64,
}

impl Samples {
    pub(crate) fn take(layout: &CodeLayout, pictures: &[Photo]) -> Self {
        let [white, black] = layout.white_black_at();
        let places = places(pictures.first());
        let codes = read(pictures.get(..=black).unwrap_or(pictures), &places);
        let spread = |codes: &[i32]| {
            let (low, high) = codes.iter().fold((i32::MAX, 0), |(l, h), &c| (l.min(c), h.max(c)));
            (low, high.saturating_sub(low))
        };
        let spreads: Vec<(i32, i32)> = codes.iter().map(|c| spread(c)).collect();
        // A masked picture is dark away from the board in all patterns, in white perhaps not,
        // wherever that stands. Half of the patterns light a pixel: of all, the middle half differ.
        let patterns = |codes: &[i32]| {
            let mut codes = codes.to_vec();
            let quarter = codes.len() / 4;
            let low = *codes.select_nth_unstable(quarter).1;
            *codes.select_nth_unstable(3 * quarter).1 - low
        };
        let most = spreads.iter().map(|s| s.1).max().unwrap_or(0);
        let least = (LIT * f64::from(most)).max(2.0) as i32;
        let pairs = white / 2;
        let mut noise = Vec::new();
        let (mut shares, mut lines, mut direct) = (Vec::new(), Vec::new(), Vec::new());
        let mut ranges = Vec::new();
        let fine: Vec<usize> = fine_pictures(layout).collect();
        for ((codes, &(low, high)), &(line, ..)) in codes.iter().zip(&spreads).zip(&places) {
            if high < least || patterns(codes) < least {
                continue;
            }
            shares.push(codes.iter().map(|&c| (c - low) as f32 / high as f32).collect());
            lines.push(line);
            ranges.push(high);
            let fine: Vec<i32> = fine.iter().filter_map(|&at| codes.get(at).copied()).collect();
            let (darkest, range) = spread(&fine);
            let dark = codes.get(black).copied().unwrap_or(low);
            let light = Separation::new(darkest.saturating_add(range), darkest, dark);
            direct.push(light.direct > light.global);
            let sum = |pair: usize| codes[2 * pair] + codes[2 * pair + 1];
            noise.extend((1..pairs).map(|pair| (sum(pair) - sum(pair - 1)).abs()));
        }
        // Picture plus inverse is the same for all bits; the difference of two such sums has four
        // pictures' noise, that of picture and inverse two.
        let median = median_of_whole(noise);
        let noise = (1.4826 * median / 2_f64.sqrt()).max(0.5);
        let apart = |range: &i32| APART.max((APART_SIGMAS * noise) as f32 / *range as f32);
        Self {
            bits: [0, 1].map(|axis| layout.bits(axis)),
            bit_at: [0, 1].map(|axis| layout.bit_at(axis, layout.bits(axis) - 1)),
            apart: ranges.iter().map(apart).collect(),
            shares,
            direct,
            lines,
            pictures: (black + 1).min(pictures.len()),
            noise,
        }
    }

    /// Pictures up to black.
    pub(crate) fn pictures(&self) -> usize {
        self.pictures
    }

    /// Whether more of the lit pixels are brighter in picture `a` than in `b` than the other way.
    pub(crate) fn brighter(&self, a: usize, b: usize) -> bool {
        self.shares.iter().filter(|s| s[a] > s[b]).count()
            > self.shares.iter().filter(|s| s[a] < s[b]).count()
    }

    /// Lit pixels.
    pub(crate) fn lit(&self) -> usize {
        self.shares.len()
    }

    /// Standard deviation of picture minus inverse, codes; at least the rounding's.
    pub(crate) fn noise(&self) -> f64 {
        self.noise
    }

    /// The first picture of each pair that is not picture and inverse, or white and black, if
    /// place i of the sequence is taken by picture `order[i]`.
    pub(crate) fn unpaired(&self, order: &[usize], most: f64) -> Vec<usize> {
        let pairs = (0..self.pictures / 2).map(|pair| 2 * pair);
        let last = self.pictures.saturating_sub(2);
        let share = |at: usize| {
            let same = |s: &&Vec<f32>| {
                let [a, b] = [order[at], order[at + 1]].map(|picture| s[picture]);
                let alike = (a > 1.0 - CLEAR && b > 1.0 - CLEAR) || (a < CLEAR && b < CLEAR);
                alike || (at == last && a < b)
            };
            self.shares.iter().filter(same).count() as f64 / self.lit().max(1) as f64
        };
        pairs.filter(|&at| share(at) > most).collect()
    }

    /// Of the `doubtful` pictures one that looks like any other picture, and that one.
    pub(crate) fn twins(&self, doubtful: &[usize]) -> Option<(usize, usize)> {
        let alike = |a: usize, b: usize| {
            let far = self.shares.iter().filter(|s| (s[a] - s[b]).abs() > CLEAR).count();
            a != b && (far as f64) < 0.01 * self.lit() as f64
        };
        let others = 0..self.pictures;
        doubtful.iter().find_map(|&a| others.clone().find(|&b| alike(a, b)).map(|b| (a, b)))
    }

    /// The way of an axis' code along all lines.
    pub(crate) fn way(&self, order: &[usize], axis: usize) -> Way {
        let mut way = Way { length: 0.0, range: 0.0 };
        let mut line: Option<(usize, u32, u32, u32)> = None;
        let bits = self.usable(order, axis);
        for (pixel, number) in self.direct_ones() {
            let Some(code) = self.code(pixel, order, axis, bits) else { continue };
            line = match line {
                Some((current, last, low, high)) if current == number => {
                    way.length += f64::from(code.abs_diff(last));
                    Some((current, code, low.min(code), high.max(code)))
                }
                ended => {
                    way.range += ended.map_or(0.0, |(_, _, low, high)| f64::from(high - low));
                    Some((number, code, code, code))
                }
            };
        }
        way.range += line.map_or(0.0, |(_, _, low, high)| f64::from(high - low));
        way
    }

    /// Pixels whose code means something, each with its line.
    fn direct_ones(&self) -> impl Iterator<Item = (usize, usize)> {
        let pixels = self.lines.iter().zip(&self.direct).enumerate();
        pixels.filter(|(_, (_, direct))| **direct).map(|(pixel, (&line, _))| (pixel, line))
    }

    /// Bits of an axis, from the coarsest, before the blur drowns them.
    fn usable(&self, order: &[usize], axis: usize) -> u32 {
        let enough = LEAST_APART * self.lit() as f64;
        let first = self.bit_at[axis];
        let told = |bit: &u32| {
            let at = first + 2 * *bit as usize;
            let pixels = self.shares.iter().zip(&self.apart);
            let apart =
                pixels.filter(|(s, least)| (s[order[at]] - s[order[at + 1]]).abs() >= **least);
            apart.count() as f64 >= enough
        };
        (0..self.bits[axis]).take_while(told).count() as u32
    }

    /// The code of an axis by its coarsest `bits`, where none of them is in doubt.
    fn code(&self, pixel: usize, order: &[usize], axis: usize, bits: u32) -> Option<u32> {
        let (shares, first) = (&self.shares[pixel], self.bit_at[axis]);
        let mut gray = 0;
        for bit in 0..bits {
            let at = first + 2 * bit as usize;
            let [p, q] = [order[at], order[at + 1]].map(|picture| shares[picture]);
            if (p - q).abs() < self.apart[pixel] {
                return None;
            }
            gray = gray << 1 | u32::from(p > q);
        }
        Some(gray_to_binary(gray))
    }

    /// The exchange of a picture with its inverse, or with the picture of another bit (the
    /// inverses with each other as well), that shortens the way of an axis' code most, if below
    /// `length`.
    pub(crate) fn shortest_exchange(
        &self,
        order: &[usize],
        axis: usize,
        length: f64,
    ) -> Option<(usize, usize)> {
        let place = |bit: u32| self.bit_at[axis] + 2 * bit as usize;
        let bits = self.bits[axis];
        let mut tries: Vec<(usize, usize)> = (0..bits).map(|b| (place(b), place(b) + 1)).collect();
        tries.extend(
            (0..bits)
                .flat_map(|a| (a + 1..bits).map(move |b| (a, b)))
                .map(|(a, b)| (place(a), place(b))),
        );
        let mut best = (length, None);
        for (a, b) in tries {
            let mut order = order.to_vec();
            order.swap(a, b);
            if b != a + 1 {
                order.swap(a + 1, b + 1);
            }
            let tried = self.way(&order, axis).length;
            if tried < best.0 {
                best = (tried, Some((a, b)));
            }
        }
        best.1
    }

    /// Of some exchanges the likeliest: those that leave the projector's picture turned as
    /// `mirrored` says, if any do, and of these the ones whose codes go the shortest way.
    pub(crate) fn likeliest(
        &self,
        exchanges: &[(usize, usize)],
        mirrored: bool,
    ) -> Vec<(usize, usize)> {
        let mut order: Vec<usize> = (0..self.pictures).collect();
        let tried = exchanges.iter().map(|&(a, b)| {
            order.swap(a, b);
            let turned = (self.handedness(&order) < 0.0) != mirrored;
            let length = self.way(&order, 0).length + self.way(&order, 1).length;
            order.swap(a, b);
            (turned, length, (a, b))
        });
        let tried: Vec<_> = tried.collect();
        let any = tried.iter().any(|t| !t.0);
        let left = || tried.iter().filter(|t| !(any && t.0));
        let least = left().map(|t| t.1).fold(f64::INFINITY, f64::min);
        left().filter(|t| t.1 <= AS_SHORT * least).map(|t| t.2).collect()
    }

    /// The bits, of both axes, that would mirror a code without a jump if their picture and inverse
    /// were exchanged: those that the lit pixels lie to one side of the middle of.
    pub(crate) fn mirroring(&self, order: &[usize]) -> Vec<(usize, usize)> {
        let mut out = Vec::new();
        for axis in 0..2 {
            let length = self.way(order, axis).length;
            for bit in 0..self.usable(order, axis) {
                let at = self.bit_at[axis] + 2 * bit as usize;
                let mut order = order.to_vec();
                order.swap(at, at + 1);
                if self.way(&order, axis).length <= AS_SHORT * length {
                    out.push((at, at + 1));
                }
            }
        }
        out
    }

    /// Positive if columns and rows turn the same way round in the projector's picture as in the
    /// camera's.
    pub(crate) fn handedness(&self, order: &[usize]) -> f64 {
        // Mean steps of column and row code along rows and along columns of the camera.
        let mut slopes = [[0.0; 2]; 2];
        for (axis, slope) in slopes.iter_mut().enumerate() {
            let mut last: Option<(usize, u32)> = None;
            let bits = self.usable(order, axis);
            for (pixel, line) in self.direct_ones() {
                let Some(code) = self.code(pixel, order, axis, bits) else { continue };
                if let Some((_, before)) = last.filter(|(on, _)| *on == line) {
                    // One wild step must not outweigh a line of small ones.
                    slope[line % 2] += (f64::from(code) - f64::from(before)).clamp(-8.0, 8.0);
                }
                last = Some((line, code));
            }
        }
        let [[cx, cy], [rx, ry]] = slopes;
        cx * ry - cy * rx
    }
}

/// The pictures, inverses included, that tell direct from indirect light.
fn fine_pictures(layout: &CodeLayout) -> impl Iterator<Item = usize> {
    [0, 1].into_iter().flat_map(move |axis| {
        let bits = SEPARATING_BITS.filter(move |&bit| bit < layout.bits(axis));
        bits.flat_map(move |bit| [0, 1].map(|inverse| layout.bit_at(axis, bit) + inverse))
    })
}

/// Median of whole numbers from 0, each standing for what was rounded to it.
fn median_of_whole(mut numbers: Vec<i32>) -> f64 {
    numbers.sort_unstable();
    let half = numbers.len() / 2;
    let Some(&middle) = numbers.get(half) else { return 0.0 };
    let below = numbers.partition_point(|&n| n < middle);
    let up_to = numbers.partition_point(|&n| n <= middle);
    let within = (half - below) as f64 / (up_to - below) as f64;
    if middle == 0 { 0.5 * within } else { f64::from(middle) - 0.5 + within }
}

/// Line, column and row of each sample, lines one after the other.
fn places(first: Option<&Photo>) -> Vec<(usize, usize, usize)> {
    let Some(photo) = first else { return Vec::new() };
    let (width, height) = (photo.width, photo.height);
    let spread = |size: usize| (0..LINES).map(move |i| (2 * i + 1) * size / (2 * LINES));
    let along = spread(height).enumerate();
    let down = spread(width).enumerate();
    along
        .flat_map(|(i, y)| (0..width).map(move |x| (2 * i, x, y)))
        .chain(down.flat_map(|(i, x)| (0..height).map(move |y| (2 * i + 1, x, y))))
        .collect()
}

/// Codes of all pictures at each place.
fn read(pictures: &[Photo], places: &[(usize, usize, usize)]) -> Vec<Vec<i32>> {
    let pixel = |photo: &Photo, x: usize, y: usize| {
        let start = (y * photo.width + x) * photo.channels;
        grey(photo.data.get(start..start + photo.channels).unwrap_or_default())
    };
    places.par_iter().map(|&(_, x, y)| pictures.iter().map(|p| pixel(p, x, y)).collect()).collect()
}
