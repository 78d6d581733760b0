//! The work over a whole picture: strips that memory holds, blocks that the first cache holds.

use std::borrow::Cow;

use rayon::prelude::*;

use super::drift::{self, ExposureCheck};
use super::sensor::Channel;
use super::solve::{Exposures, LANES, Solved, solve};
use super::{Dark, Frame, MasterDarkShape};
use crate::error::Result;
use crate::photo::Photo;
use crate::radiometry::masters::FlatField;
use crate::radiometry::noise::NoiseModel;
use crate::radiometry::spool::{Plane, Spool};

/// Samples of all frames that are worked on between two looks at the spool.
const STRIP: usize = 16 << 20;

/// Blocks of one piece of work; fixed, so that sums do not depend on the number of threads.
const BLOCKS: usize = 16;

/// A misfit so far above its expectation is no noise: by chance in fewer than 1 of 10⁶ samples.
fn moved(chi2: f32, freedom: f32) -> bool {
    freedom > 0.0 && chi2 > freedom + 6.0 * (2.0 * freedom).sqrt() + 18.0
}

/// What all pieces of work share.
pub(super) struct Job<'a> {
    pub shape: &'a Photo,
    pub frames: &'a [Frame],
    pub channels: &'a [Channel],
    pub darks: &'a [(MasterDarkShape, Plane<f32>)],
    pub flat: Option<&'a FlatField>,
    pub noise: &'a NoiseModel,
    pub noise_ratio: f64,
}

impl Job<'_> {
    /// The first code that says nothing but "more".
    fn clipped_code(&self) -> u16 {
        self.noise.saturation.ceil().clamp(0.0, 65535.0) as u16
    }
}

/// Counts over the picture.
#[derive(Clone, Default)]
pub(super) struct Tally {
    pub clipped: usize,
    pub lost: usize,
    /// By exposure.
    pub moved: Vec<usize>,
}

impl Tally {
    fn plus(mut self, other: &Self) -> Self {
        self.clipped += other.clipped;
        self.lost += other.lost;
        self.moved.resize(self.moved.len().max(other.moved.len()), 0);
        self.moved.iter_mut().zip(&other.moved).for_each(|(a, b)| *a += b);
        self
    }
}

/// A strip of every frame and master dark.
struct Strip<'a> {
    codes: Vec<Cow<'a, [u16]>>,
    darks: Vec<Cow<'a, [f32]>>,
}

/// One thread's room to work in.
struct Bench {
    exposures: Vec<Exposures>,
    /// How many of them the present block has.
    used: usize,
    solved: Solved,
}

impl Bench {
    fn new(frames: &[Frame]) -> Self {
        let exposures = frames.iter().map(|_| Exposures::new());
        Self { exposures: exposures.collect(), used: 0, solved: Solved::new() }
    }

    /// The next exposure of the block.
    #[inline(always)]
    fn next(&mut self, frame: &Frame) -> &mut Exposures {
        let exposure = &mut self.exposures[self.used];
        self.used += 1;
        exposure.time = frame.few.time;
        exposure.dark_variance = match frame.dark {
            Dark::Even(_) => 0.0,
            Dark::Measured { variance, .. } => variance,
        };
        exposure
    }
}

/// Merges the few pixels, finds out how bright each exposure was, corrects the times that are
/// wrong, and measures the noise.
pub(super) fn compare(
    frames: &mut [Frame],
    channels: &[Channel],
) -> (Vec<ExposureCheck>, Option<f64>) {
    let times: Vec<f64> = frames.iter().map(|f| f.time).collect();
    let mut checks = drift::chain(&times, &[]);
    // The second round chooses its samples by the radiance that the first one corrected.
    for _ in 0..2 {
        let (radiance, _) = solve_few(frames, channels);
        let mut order: Vec<usize> = (0..radiance.len()).collect();
        order.sort_unstable_by(|a, b| radiance[*a].total_cmp(&radiance[*b]));
        let mut steps: Vec<Option<(f64, f64)>> = frames
            .par_windows(2)
            .map(|pair| drift::step(&pair[0].few, &pair[1].few, &radiance, &order, channels))
            .collect();
        // In units of the nominal times.
        for (step, pair) in steps.iter_mut().zip(checks.windows(2)) {
            let so_far = pair[0].gain / pair[1].gain;
            *step = step.map(|(ratio, sigma)| (ratio * so_far, sigma * so_far));
        }
        checks = drift::chain(&times, &steps);
        for (frame, check) in frames.iter_mut().zip(&checks) {
            frame.few.time = (frame.time * check.gain) as f32;
        }
    }
    let (_, mut ratios) = solve_few(frames, channels);
    let middle = ratios.len() / 2;
    let ratio = (!ratios.is_empty())
        .then(|| f64::from(*ratios.select_nth_unstable_by(middle, f32::total_cmp).1).sqrt());
    (checks, ratio)
}

/// Radiance of the few pixels, and each one's misfit over its median expectation.
fn solve_few(frames: &[Frame], channels: &[Channel]) -> (Vec<f32>, Vec<f32>) {
    let all = frames.first().map_or(0, |f| f.few.light.len());
    let each = all / channels.len().max(1);
    let arch = pulp::Arch::new();
    let starts: Vec<(usize, usize)> = (0..channels.len())
        .flat_map(|c| (0..each).step_by(LANES).map(move |from| (c, c * each + from)))
        .collect();
    let parts: Vec<(Vec<f32>, Vec<f32>)> = starts
        .par_iter()
        .map_init(
            || Bench::new(frames),
            |bench, &(c, from)| {
                let count = LANES.min((c + 1) * each - from);
                bench.used = 0;
                for frame in frames {
                    let exposure = bench.next(frame);
                    for l in 0..count {
                        let few = &frame.few;
                        exposure.dark[l] = few.dark[from + l];
                        exposure.x[l] = few.light[from + l] + few.dark[from + l];
                    }
                }
                arch.dispatch(Block { bench, channel: &channels[c] });
                let out = &bench.solved;
                let ratios = (0..count).filter(|&l| out.freedom[l] > 0.0).map(|l| {
                    // Wilson & Hilferty (1931): the median of χ² is n (1 − 2/(9n))³.
                    let n = out.freedom[l];
                    out.chi2[l] / (n * (1.0 - 2.0 / (9.0 * n)).powi(3))
                });
                (out.radiance[..count].to_vec(), ratios.collect())
            },
        )
        .collect();
    let (radiance, ratios): (Vec<_>, Vec<_>) = parts.into_iter().unzip();
    (radiance.concat(), ratios.concat())
}

/// Radiance and variance of every sample, and the counts.
pub(super) fn run(job: &Job, spool: &mut Spool) -> Result<(Vec<f32>, Vec<f32>, Tally)> {
    let samples = job.shape.samples();
    let (mut radiance, mut variance) = (vec![0.0_f32; samples], vec![0.0_f32; samples]);
    let piece = BLOCKS * LANES * job.shape.channels;
    let long = (STRIP / job.frames.len() / piece).max(1) * piece;
    let mut tally = Tally::default();
    let arch = pulp::Arch::new();
    let strips = radiance.chunks_mut(long).zip(variance.chunks_mut(long));
    for (k, (radiance, variance)) in strips.enumerate() {
        let range = k * long..k * long + radiance.len();
        let mut strip = Strip { codes: Vec::new(), darks: Vec::new() };
        for frame in job.frames {
            strip.codes.push(spool.part(&frame.codes, range.clone())?);
        }
        for (_, plane) in job.darks {
            strip.darks.push(spool.part(plane, range.clone())?);
        }
        let tallies: Vec<Tally> = radiance
            .par_chunks_mut(piece)
            .zip(variance.par_chunks_mut(piece))
            .enumerate()
            .map_init(
                || Bench::new(job.frames),
                |bench, (i, (radiance, variance))| {
                    let at = i * piece;
                    arch.dispatch(Piece { job, strip: &strip, at, bench, radiance, variance });
                    let mut tally = Tally { moved: vec![0; job.frames.len()], ..Tally::default() };
                    finish(job, &strip, range.start, at, radiance, variance, &mut tally);
                    tally
                },
            )
            .collect();
        tally = tallies.iter().fold(tally, Tally::plus);
    }
    Ok((radiance, variance, tally))
}

/// A block of the few pixels, to be solved with the vector unit that the machine has.
struct Block<'a> {
    bench: &'a mut Bench,
    channel: &'a Channel,
}

impl pulp::WithSimd for Block<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        solve_channel(self.bench, self.channel, 1);
    }
}

/// A piece of a strip, likewise.
struct Piece<'a> {
    job: &'a Job<'a>,
    strip: &'a Strip<'a>,
    at: usize,
    bench: &'a mut Bench,
    radiance: &'a mut [f32],
    variance: &'a mut [f32],
}

impl pulp::WithSimd for Piece<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        work(self);
    }
}

#[inline(always)]
fn solve_channel(bench: &mut Bench, channel: &Channel, like: usize) {
    let (frames, out) = (&mut bench.exposures[..bench.used], &mut bench.solved);
    if channel.is_straight() {
        solve(frames, channel.straight(), channel.clipped, like, out);
    } else {
        solve(frames, channel.curved(), channel.clipped, like, out);
    }
}

/// Solves one piece. Where a sample's exposures disagree, its variance comes out negative, for
/// [`finish`] to look into.
#[inline(always)]
fn work(piece: Piece) {
    let Piece { job, strip, at, bench, radiance, variance } = piece;
    let n = job.shape.channels;
    let size = radiance.len();
    let straight = job.channels[0].is_straight();
    // The channels of a linear camera are alike: samples are taken as they lie.
    let (parts, stride) = if straight { (1, 1) } else { (n, n) };
    // In a mosaic every other sample is of the same colour; in a grey picture it does no harm.
    let like = if !straight { 1 } else { n.max(2) };
    let worse = (job.noise_ratio * job.noise_ratio).max(1.0) as f32;
    let clipped = job.clipped_code();
    for part in 0..parts {
        let channel = &job.channels[part];
        let mut first = part;
        while first < size {
            let count = LANES.min((size - first).div_ceil(stride));
            bench.used = 0;
            let mut beyond = f32::INFINITY;
            for (k, frame) in job.frames.iter().enumerate() {
                let codes = &strip.codes[k][at + first..at + size];
                if all_clipped(codes, stride, count, clipped) {
                    // What the shortest of those clips in the whole block, longer ones clip for
                    // sure: they say nothing.
                    if frame.few.time > 1.1 * beyond {
                        continue;
                    }
                    beyond = beyond.min(frame.few.time);
                }
                let exposure = bench.next(frame);
                load(codes, stride, count, channel, &mut exposure.x);
                match frame.dark {
                    Dark::Even(level) => exposure.dark = [level; LANES],
                    Dark::Measured { masters: [a, b], share, .. } => {
                        let (a, b) = (&strip.darks[a], &strip.darks[b]);
                        for l in 0..count {
                            let (a, b) = (a[at + first + l * stride], b[at + first + l * stride]);
                            exposure.dark[l] = channel.exposure_of(a + share * (b - a));
                        }
                    }
                }
            }
            solve_channel(bench, channel, like);
            let out = &bench.solved;
            for l in 0..count {
                let place = first + l * stride;
                radiance[place] = out.radiance[l];
                let least = 1.0 / out.information[l];
                let strange = moved(out.chi2[l] / worse, out.freedom[l]);
                variance[place] =
                    if strange { -least * out.chi2[l] / out.freedom[l] } else { least };
            }
            first += count * stride;
        }
    }
}

#[inline(always)]
fn all_clipped(codes: &[u16], stride: usize, count: usize, clipped: u16) -> bool {
    if stride == 1 {
        let mut open = 0_u16;
        codes.iter().take(count).for_each(|c| open |= u16::from(*c < clipped));
        return open == 0;
    }
    codes.iter().step_by(stride).take(count).all(|c| *c >= clipped)
}

/// Codes to exposures above black.
#[inline(always)]
fn load(codes: &[u16], stride: usize, count: usize, channel: &Channel, x: &mut [f32; LANES]) {
    if let Some((scale, black)) = channel.line() {
        x.iter_mut().zip(codes).take(count).for_each(|(x, c)| *x = f32::from(*c) * scale - black);
        return;
    }
    let table = &channel.exposure;
    let last = table.len() - 1;
    let exposure = |code: u16| table[usize::from(code).min(last)];
    // A stride that the compiler knows costs half.
    match stride {
        1 => (0..count).for_each(|l| x[l] = exposure(codes[l])),
        3 => (0..count).for_each(|l| x[l] = exposure(codes[3 * l])),
        _ => (0..count).for_each(|l| x[l] = exposure(codes[stride * l])),
    }
}

fn number_of<T: Copy>(values: &[T], is: impl Fn(T) -> bool) -> usize {
    values.iter().map(|v| u32::from(is(*v))).sum::<u32>() as usize
}

/// Flat field, and the counts of what was clipped, lost or moved.
fn finish(
    job: &Job,
    strip: &Strip,
    start: usize,
    at: usize,
    radiance: &mut [f32],
    variance: &mut [f32],
    tally: &mut Tally,
) {
    let n = job.shape.channels;
    let longest = job.frames.last().map_or(1.0, |f| f.few.time);
    let lost = (job.noise.read_noise / job.noise.full_scale) as f32 / longest;
    let clipped = job.clipped_code();
    let shortest = &strip.codes[0][at..at + radiance.len()];
    // Most pieces have none of these, which sums without branches tell fast.
    if number_of(shortest, |c| c >= clipped) > 0 {
        let pixels = shortest.chunks_exact(n);
        tally.clipped += pixels.filter(|codes| codes.iter().any(|c| *c >= clipped)).count();
    }
    if number_of(radiance, |l| l <= lost) > 0 {
        let pixels = radiance.chunks_exact(n);
        tally.lost += pixels.filter(|samples| samples.iter().all(|l| *l <= lost)).count();
    }
    let strange = number_of(variance, |v| v < 0.0);
    let all = variance.iter_mut().enumerate();
    for (i, variance) in all.filter(|(_, v)| **v < 0.0).take(strange) {
        *variance = -*variance;
        let channel = &job.channels[(i % n).min(job.channels.len() - 1)];
        let off = |k: usize| {
            let frame = &job.frames[k];
            let dark = match frame.dark {
                Dark::Even(level) => level,
                Dark::Measured { masters: [a, b], share, .. } => {
                    let (a, b) = (strip.darks[a][at + i], strip.darks[b][at + i]);
                    channel.exposure_of(a + share * (b - a))
                }
            };
            let mean = frame.few.time * radiance[i] + dark;
            let code = usize::from(strip.codes[k][at + i]).min(channel.exposure.len() - 1);
            let counts = if mean < channel.clipped { 1.0 } else { 0.0 };
            counts * (channel.exposure[code] - mean).powi(2) / channel.variance(mean)
        };
        let misfits = (0..job.frames.len()).map(|k| (off(k), k));
        if let Some((_, worst)) = misfits.max_by(|a, b| a.0.total_cmp(&b.0)) {
            tally.moved[worst] += 1;
        }
    }
    if let Some(flat) = job.flat {
        let gains = &flat.gain[start + at..];
        for ((radiance, variance), gain) in radiance.iter_mut().zip(variance).zip(gains) {
            *radiance /= gain;
            *variance = *variance / (gain * gain) + flat.relative_variance * *radiance * *radiance;
        }
    }
}
