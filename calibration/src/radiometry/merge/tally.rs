//! What becomes of a piece after it is solved: the flat field, and what is counted over the picture.

use super::strips::{Job, Strip};

/// Counts over the picture.
#[derive(Clone, Default)]
pub(super) struct Tally {
    pub clipped: usize,
    pub lost: usize,
    /// By exposure.
    pub moved: Vec<usize>,
}

impl Tally {
    pub fn plus(mut self, other: &Self) -> Self {
        self.clipped += other.clipped;
        self.lost += other.lost;
        self.moved.resize(self.moved.len().max(other.moved.len()), 0);
        self.moved.iter_mut().zip(&other.moved).for_each(|(a, b)| *a += b);
        self
    }
}

fn number_of<T: Copy>(values: &[T], is: impl Fn(T) -> bool) -> usize {
    values.iter().map(|v| u32::from(is(*v))).sum::<u32>() as usize
}

/// Applies the flat field, and counts what was clipped, lost or moved.
pub(super) fn finish(
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
            let dark = frame.dark.exposure(channel, |m| strip.darks[m][at + i]);
            let mean = frame.few.time * radiance[i] + dark;
            let code = usize::from(strip.codes[k][at + i]);
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
