//! The work over a whole picture: strips that memory holds, blocks that the first cache holds.

use std::borrow::Cow;

use rayon::prelude::*;

use super::drift::{self, ExposureCheck};
use super::sensor::{Apart, Channel, Fused, MultiplyAdd};
use super::solve::{Exposures, LANES, Solved, solve};
use super::tally::{Tally, finish};
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
    pub fn clipped_code(&self) -> u16 {
        self.noise.saturation.ceil().clamp(0.0, 65535.0) as u16
    }
}

/// A strip of every frame and master dark.
pub(super) struct Strip<'a> {
    pub codes: Vec<Cow<'a, [u16]>>,
    pub darks: Vec<Cow<'a, [f32]>>,
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
            Dark::Unmeasured => 0.0,
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
    let (mut radiance, mut ratios) = solve_few(frames, channels);
    // The second round chooses its samples by the radiance that the first one corrected.
    for _ in 0..2 {
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
        let gains: Vec<f64> = checks.iter().map(|c| c.gain).collect();
        checks = drift::chain(&times, &steps);
        if checks.iter().zip(gains).all(|(check, before)| check.gain == before) {
            break;
        }
        for (frame, check) in frames.iter_mut().zip(&checks) {
            frame.few.time = (frame.time * check.gain) as f32;
        }
        (radiance, ratios) = solve_few(frames, channels);
    }
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
                    pad(exposure, count, 1);
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
        if S::IS_SCALAR {
            solve_channel::<Apart>(self.bench, self.channel, 1);
        } else {
            solve_channel::<Fused>(self.bench, self.channel, 1);
        }
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
        if S::IS_SCALAR {
            work::<Apart>(self);
        } else {
            work::<Fused>(self);
        }
    }
}

#[inline(always)]
fn solve_channel<F: MultiplyAdd>(bench: &mut Bench, channel: &Channel, like: usize) {
    let (frames, out) = (&mut bench.exposures[..bench.used], &mut bench.solved);
    if channel.is_straight() {
        solve::<_, F>(frames, channel.straight(), channel.clipped, like, out);
    } else {
        solve::<_, F>(frames, channel.curved(), channel.clipped, like, out);
    }
}

/// Solves one piece. Where a sample's exposures disagree, its variance comes out negative, for
/// [`finish`] to look into.
#[inline(always)]
fn work<F: MultiplyAdd>(piece: Piece) {
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
                for l in 0..count {
                    let place = at + first + l * stride;
                    exposure.dark[l] = frame.dark.exposure(channel, |m| strip.darks[m][place]);
                }
                pad(exposure, count, like);
            }
            solve_channel::<F>(bench, channel, like);
            let out = &bench.solved;
            let mut spread = out.information;
            for l in 0..LANES {
                let least = 1.0 / out.information[l];
                let strange = moved(out.chi2[l] / worse, out.freedom[l]);
                spread[l] = if strange { -least * out.chi2[l] / out.freedom[l] } else { least };
            }
            let lanes = out.radiance.iter().zip(&spread).take(count);
            let places = radiance[first..].chunks_mut(stride);
            for ((l, v), (radiance, variance)) in
                lanes.zip(places.zip(variance[first..].chunks_mut(stride)))
            {
                (radiance[0], variance[0]) = (*l, *v);
            }
            first += count * stride;
        }
    }
}

/// Fills the lanes that a short block leaves with its last samples of each colour: lanes look at their
/// neighbours, and what an earlier block has left there depends on which thread did which block.
#[inline(always)]
fn pad(exposure: &mut Exposures, count: usize, like: usize) {
    for l in count..LANES {
        let from = l.checked_sub(like).unwrap_or(count - 1);
        (exposure.x[l], exposure.dark[l]) = (exposure.x[from], exposure.dark[from]);
    }
}

#[inline(always)]
fn all_clipped(codes: &[u16], stride: usize, count: usize, clipped: u16) -> bool {
    // Nearly always the first of them tells.
    if codes[0] < clipped {
        return false;
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
    // A stride that the compiler knows costs half.
    match stride {
        3 => look_up::<3>(&codes[..codes.len().min(3 * count)], channel, x),
        _ => look_up::<1>(&codes[..count], channel, x),
    }
}

#[inline(always)]
fn look_up<const STRIDE: usize>(codes: &[u16], channel: &Channel, x: &mut [f32; LANES]) {
    let table = &channel.exposure;
    x.iter_mut().zip(codes.chunks(STRIDE)).for_each(|(x, c)| *x = table[usize::from(c[0])]);
}
