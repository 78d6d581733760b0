//! How long a rig takes, learned from what it has done.

use serde::Serialize;

use crate::{Event, Recorded};

/// What a frame takes beside its exposure where nothing is known of the rig, seconds: reading it
/// out, showing the next image, writing the last one.
pub const PER_FRAME_S: f64 = 0.5;
/// Frames below which nothing is learned.
const LEAST: usize = 8;
/// Longer between two frames, seconds beyond the exposure, is somebody's pause.
const PAUSE_S: f64 = 60.0;

/// The time that a frame and a placement take, with their spread.
///
/// A frame takes `per_frame_s + per_exposure × exposure`: the simulated camera does not wait, so
/// its `per_exposure` is 0, real ones have 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Timing {
    /// Frames that this was learned from.
    pub frames: usize,
    /// Seconds, beside the exposure.
    pub per_frame_s: f64,
    /// Seconds a second of exposure.
    pub per_exposure: f64,
    /// Standard deviation of a frame's time, seconds.
    pub frame_sd_s: f64,
    /// Placements that this was learned from; 0 leaves the next two at their guess.
    pub placements: usize,
    /// Seconds.
    pub per_placement_s: f64,
    /// Standard deviation of a placement's time, seconds.
    pub placement_sd_s: f64,
}

/// Where nothing was learned: somebody who walks to the bench takes a minute.
impl Default for Timing {
    fn default() -> Self {
        Self {
            frames: 0,
            per_frame_s: PER_FRAME_S,
            per_exposure: 1.0,
            frame_sd_s: 0.25,
            placements: 0,
            per_placement_s: 60.0,
            placement_sd_s: 30.0,
        }
    }
}

/// Times that were seen: of frames with their exposures, and of placements, seconds.
#[derive(Clone, Debug, Default)]
pub(crate) struct Seen {
    pub frames: Vec<(f64, f64)>,
    pub placements: Vec<f64>,
}

impl Seen {
    /// Adds what a journal tells.
    pub fn add(&mut self, journal: &Recorded) {
        for pair in journal.entries.windows(2) {
            let passed_s = pair[1].unix_s - pair[0].unix_s;
            match (&pair[0].event, &pair[1].event) {
                // Both are told when they are on the disk, so the writing is in it once.
                (Event::FrameWritten { .. }, Event::FrameWritten { exposure_s, .. }) => {
                    self.frame(*exposure_s, passed_s);
                }
                (_, Event::Placed { took_s, .. }) => self.placements.push(*took_s),
                _ => {}
            }
        }
    }

    /// Adds a frame that came so long after the one before, unless somebody made a pause.
    pub fn frame(&mut self, exposure_s: f64, passed_s: f64) {
        if (0.0..PAUSE_S + exposure_s).contains(&passed_s) {
            self.frames.push((exposure_s, passed_s));
        }
    }

    /// What follows from it; the [`Timing::default`] where it is too little.
    pub fn timing(&self) -> Timing {
        let mut out = Timing::default();
        if self.frames.len() >= LEAST {
            let (a, b, sd) = line(&self.frames);
            (out.frames, out.frame_sd_s) = (self.frames.len(), sd);
            (out.per_frame_s, out.per_exposure) = (a.max(0.0), b.max(0.0));
        }
        if self.placements.len() >= 2 {
            let points: Vec<_> = self.placements.iter().map(|took| (0.0, *took)).collect();
            let (mean, _, sd) = line(&points);
            (out.placements, out.per_placement_s, out.placement_sd_s) =
                (self.placements.len(), mean, sd);
        }
        out
    }
}

impl Timing {
    /// What journals of the same rig tell; the [`Default`] where they tell too little.
    pub fn learned<'a>(journals: impl IntoIterator<Item = &'a Recorded>) -> Self {
        let mut seen = Seen::default();
        journals.into_iter().for_each(|journal| seen.add(journal));
        seen.timing()
    }

    /// Expected time and its standard deviation, seconds, of so much work. The spread is that of
    /// the sum of independent frames and placements, and of what was learned from few of them.
    pub fn estimate(&self, frames: usize, exposure_s: f64, placements: usize) -> [f64; 2] {
        let (n, m) = (frames as f64, placements as f64);
        let expected =
            n * self.per_frame_s + self.per_exposure * exposure_s + m * self.per_placement_s;
        let variance =
            |n: f64, sd: f64, learned: usize| sd * sd * (n + n * n / learned.max(1) as f64);
        let variance = variance(n, self.frame_sd_s, self.frames)
            + variance(m, self.placement_sd_s, self.placements);
        [expected, variance.sqrt()]
    }
}

/// Offset, slope and scatter of y over x by least squares; slope 0 where x does not vary.
fn line(points: &[(f64, f64)]) -> (f64, f64, f64) {
    let n = points.len() as f64;
    let mean = |of: &dyn Fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / n;
    let (x, y) = (mean(&|p| p.0), mean(&|p| p.1));
    let xx = mean(&|p| (p.0 - x).powi(2));
    let slope = if xx > 0.0 { mean(&|p| (p.0 - x) * (p.1 - y)) / xx } else { 0.0 };
    let offset = y - slope * x;
    let free = (n - if xx > 0.0 { 2.0 } else { 1.0 }).max(1.0);
    let scatter = (n * mean(&|p| (p.1 - offset - slope * p.0).powi(2)) / free).sqrt();
    (offset, slope, scatter)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Entry, FrameStats, Readback, Target};

    fn frame(exposure_s: f64) -> Event {
        let stats =
            FrameStats { min: 0, max: 9, mean: 1.0, clipped_share: 0.0, focus: 0.0, patch: None };
        Event::FrameWritten {
            shot: "a".into(),
            exposure_index: 0,
            repeat: 0,
            file: "a".into(),
            blake3: String::new(),
            settings: String::new(),
            requested_s: None,
            exposure_s,
            device: Readback::default(),
            stats,
        }
    }

    /// Frames of 0.3 s and their exposure, every other one 0.2 s late, a pause that does not count,
    /// and two placements.
    #[test]
    fn a_rig_s_time_is_learned_from_its_journal() {
        let (mut entries, mut now) = (Vec::new(), 1000.0);
        let mut put = |now: f64, event| {
            entries.push(Entry { seq: entries.len() as u64, unix_s: now, event });
        };
        put(now, frame(0.1));
        for i in 0..40 {
            let exposure_s = [0.1, 0.1, 2.0, 2.0][i % 4];
            now += 0.3 + exposure_s + if i % 2 == 0 { 0.2 } else { 0.0 };
            if i == 20 {
                now += 4000.0;
            }
            put(now, frame(exposure_s));
        }
        for took_s in [20.0, 40.0] {
            now += took_s;
            put(now, Event::Placed { target: Target::Sample, took_s });
        }
        let recorded = Recorded { entries, torn_bytes: 0 };
        let timing = Timing::learned([&recorded]);
        assert_eq!((timing.frames, timing.placements), (39, 2));
        // 40 frames without the one after the pause: rounding, and the unbalanced late ones.
        assert!((timing.per_frame_s - 0.4).abs() < 0.01, "{timing:?}");
        assert!((timing.per_exposure - 1.0).abs() < 0.01, "{timing:?}");
        assert!((timing.frame_sd_s - 0.1).abs() < 0.01, "{timing:?}");
        assert!((timing.per_placement_s - 30.0).abs() < 1e-9);
        assert!((timing.placement_sd_s - 200.0_f64.sqrt()).abs() < 1e-9);
        let [expected, spread] = timing.estimate(100, 80.0, 1);
        assert!((expected - (40.0 + 80.0 + 30.0)).abs() < 2.0, "{expected}");
        // One placement, known from two: 14.1 √1.5; a hundred frames, known from 39: 0.1 √356.
        assert!((spread - (300.0 + 3.56_f64).sqrt()).abs() < 0.2, "{spread}");
        assert_eq!(Timing::learned([&Recorded::default()]), Timing::default());
    }
}
