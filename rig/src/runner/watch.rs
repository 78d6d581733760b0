//! Looks at every frame as it is written, so that what spoils a capture is told while it can still
//! be mended.

use std::collections::HashMap;

use serde::{Deserialize, Serialize};

use crate::survey::{PROBES, Survey, probed};
use crate::{FrameMetadata, PatchStats, Pattern, Purpose, Target};

/// Share of values that may be clipped in the shortest exposure: hot pixels and a glint.
const MOST_CLIPPED: f64 = 1e-3;
/// Share of full scale that the brightest part of the longest exposure should reach: below, the
/// steps of 8 bits are coarser than 20 % of it.
const LEAST_BRIGHT: f64 = 0.02;
/// Share of an exposure by which the camera may miss it unremarked.
const MOST_ROUNDED: f64 = 0.01;
/// Light of the black frame over that of a lit one: so much is subtracted, with its noise.
const MOST_AMBIENT: f64 = 0.1;
/// Change of the reference patch's brightness: three times what the solver allows a picture to be
/// wrong by.
const MOST_LAMP_DRIFT: f64 = 0.01;
/// Change of the reference patch's focus score: a printed edge that is blurred by another half of
/// its width loses about as much.
const MOST_FOCUS_DRIFT: f64 = 0.2;
/// Share of full scale that the reference patch needs to be compared.
const LEAST_PATCH: f64 = 0.05;
/// Share of full scale that the longer exposure of a pixel needs to be compared.
const LEAST_BRIGHT_ROW: f64 = 0.1;
/// How far a row may be from what the others say: a split frame is off by as much as the picture
/// changed, a wavy one by the part of a turn that the exposures differ by.
const MOST_UNSYNCED: f64 = 0.03;
/// Probes of a piece of the curve.
const PIECE: usize = 64;
/// Brightest over darkest value of a piece: a camera's response is straight within.
const WIDEST: f64 = 1.2;
/// Probes that a row needs to be judged.
const LEAST_PROBES: u32 = 8;

/// What is doubtful about a frame, though it was kept.
#[derive(Clone, Debug, PartialEq, thiserror::Error, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Warning {
    /// Too much light for the shortest exposure.
    #[error(
        "{:.1} % of the values are clipped at the shortest exposure, {exposure_s:.4} s: add shorter ones, or close the aperture",
        100.0 * share
    )]
    Clipped {
        /// The exposure, seconds.
        exposure_s: f64,
        /// Share of the values.
        share: f64,
    },
    /// Too little light for the longest exposure.
    #[error(
        "its brightest part reaches {:.1} % of full scale at the longest exposure, {exposure_s:.3} s: add longer ones, or open the aperture",
        100.0 * share
    )]
    Dim {
        /// The exposure, seconds.
        exposure_s: f64,
        /// Share of full scale.
        share: f64,
    },
    /// The camera took another exposure than it was asked for.
    #[error("asked for {requested_s:.6} s, the camera exposed for {exposure_s:.6} s")]
    Rounded {
        /// Asked for, seconds.
        requested_s: f64,
        /// Used, seconds.
        exposure_s: f64,
    },
    /// The black frame is bright.
    #[error(
        "the black frame has {:.0} % of this shot's light: darken the room, or shade the camera",
        100.0 * share
    )]
    Ambient {
        /// Light of the black frame over that of the lit one.
        share: f64,
    },
    /// The lamp is not what it was.
    #[error("the reference patch is {:+.1} % brighter than in the first shot: the lamp drifts", 100.0 * change)]
    LampDrift {
        /// Relative change of its brightness.
        change: f64,
    },
    /// The picture is not as sharp as it was, or sharper.
    #[error("the reference patch's focus score has changed by {:+.0} % since the first shot: somebody touched lens or bench", 100.0 * change)]
    FocusDrift {
        /// Relative change of its score.
        change: f64,
    },
    /// Camera and projector are not in step.
    #[error(
        "row {row} and others differ by {:.0} % from what the other exposure says: a split or wavy frame, camera and projector out of step",
        100.0 * change
    )]
    OutOfSync {
        /// The row that is farthest off.
        row: u32,
        /// How far it is off, relatively.
        change: f64,
    },
}

/// What was seen so far.
#[derive(Default)]
pub(super) struct Watch {
    /// The shot at hand.
    shot: String,
    /// Its frames.
    frames: Vec<Seen>,
    /// Light of the black frame of each target, tile by tile, digital numbers a second.
    black: HashMap<Target, Vec<Option<f64>>>,
    /// The reference patch at each exposure, as it looked in the first shot, and that frame's
    /// smallest value.
    patch: HashMap<u64, (PatchStats, f64)>,
}

struct Seen {
    exposure_s: f64,
    tiles: Vec<Option<f64>>,
    probes: Vec<Option<u16>>,
    min: f64,
}

impl Watch {
    /// What is doubtful about a frame of a shot whose shortest and longest exposures are
    /// `bracket_s`.
    pub fn see(
        &mut self,
        frame: &FrameMetadata,
        survey: &Survey,
        bracket_s: [f64; 2],
    ) -> Vec<Warning> {
        if self.shot != frame.shot {
            self.shot = frame.shot.clone();
            self.frames.clear();
        }
        let (requested_s, exposure_s) = (frame.requested_s, frame.exposure_s);
        let mut warnings = Vec::new();
        if (exposure_s / requested_s - 1.0).abs() > MOST_ROUNDED {
            warnings.push(Warning::Rounded { requested_s, exposure_s });
        }
        // A burst is meant to show the wheel, the panel has its own light, boards need no bracket.
        if matches!(frame.purpose, Purpose::Wheel | Purpose::Noise | Purpose::Geometry)
            || frame.target == Target::Dark
        {
            return warnings;
        }
        let stats = survey.stats();
        let full = survey.full_scale();
        let [shortest, longest] = bracket_s;
        if requested_s == shortest && stats.clipped_share > MOST_CLIPPED {
            warnings.push(Warning::Clipped { exposure_s, share: stats.clipped_share });
        }
        // The projector's response has dark steps, and steps that differ.
        if frame.purpose == Purpose::Light {
            return warnings;
        }
        let seen = Seen {
            exposure_s,
            tiles: survey.tiles(),
            probes: survey.probes(),
            min: f64::from(stats.min),
        };
        let is_black = frame.pattern == Pattern::Black;
        if requested_s == longest && !is_black && stats.clipped_share == 0.0 {
            let brightest = seen.tiles.iter().flatten().copied().fold(0.0, f64::max);
            let share = (brightest - seen.min) / full;
            if share < LEAST_BRIGHT {
                warnings.push(Warning::Dim { exposure_s, share });
            }
        }
        // Only pictures of the block have the patch lit, and nothing else on the bench.
        if matches!(frame.purpose, Purpose::Fit | Purpose::HeldOut | Purpose::Surface)
            && let Some(patch) = stats.patch.filter(|patch| patch.mean < 0.9 * full)
        {
            warnings.extend(self.drift(requested_s, patch, seen.min, full));
        }
        if let Some(before) = self.frames.last()
            && before.exposure_s != exposure_s
        {
            warnings.extend(out_of_sync(before, &seen, full, survey.height()));
        }
        self.frames.push(seen);
        if requested_s == longest {
            warnings.extend(self.ambient(frame.target, is_black));
        }
        warnings
    }

    /// How the reference patch has changed since the first frame of that exposure.
    fn drift(&mut self, requested_s: f64, patch: PatchStats, min: f64, full: f64) -> Vec<Warning> {
        let (first, dark) = *self.patch.entry(requested_s.to_bits()).or_insert((patch, min));
        if first.mean - dark < LEAST_PATCH * full {
            // Too dim to tell a hundredth.
            return Vec::new();
        }
        let change = (patch.mean - first.mean) / (first.mean - dark);
        let lamp = (change.abs() > MOST_LAMP_DRIFT).then_some(Warning::LampDrift { change });
        // Noise has a contrast of its own, which hides that of a dark patch.
        let bright = first.mean - dark > 0.2 * first.mean;
        let change = patch.focus / first.focus - 1.0;
        let focus =
            (bright && change.abs() > MOST_FOCUS_DRIFT).then_some(Warning::FocusDrift { change });
        [lamp, focus].into_iter().flatten().collect()
    }

    /// Whether the black frame of the same target has too much of the shot's light, where that is
    /// brightest.
    fn ambient(&mut self, target: Target, is_black: bool) -> Option<Warning> {
        let light = self.light();
        if is_black {
            self.black.insert(target, light);
            return None;
        }
        let shortest = self.frames.iter().min_by(|a, b| a.exposure_s.total_cmp(&b.exposure_s))?;
        let known = shortest.tiles.iter().enumerate().filter_map(|(i, mean)| Some((i, (*mean)?)));
        let (brightest, _) = known.max_by(|a, b| a.1.total_cmp(&b.1))?;
        let black = (*self.black.get(&target)?.get(brightest)?)?;
        let share = black / (*light.get(brightest)?).filter(|light| *light > 0.0)?;
        (share > MOST_AMBIENT).then_some(Warning::Ambient { share })
    }

    /// Light of the shot's tiles, digital numbers a second: from the growth between the shortest and
    /// the longest exposure that are not clipped there, so that a dark level cancels.
    fn light(&self) -> Vec<Option<f64>> {
        let tiles = self.frames.first().map_or(0, |frame| frame.tiles.len());
        let growth = |tile: usize| {
            let means = self.frames.iter().filter_map(|f| Some((f.exposure_s, f.tiles[tile]?)));
            let short = means.clone().min_by(|a, b| a.0.total_cmp(&b.0))?;
            let long = means.max_by(|a, b| a.0.total_cmp(&b.0))?;
            (long.0 > short.0).then(|| (long.1 - short.1) / (long.0 - short.0))
        };
        (0..tiles).map(growth).collect()
    }
}

/// The row that is farthest from the others in how the values of two exposures belong together.
///
/// Where nothing moves, the longer exposure's value is one function of the shorter's, the same all
/// over the picture, whatever the camera's response is. It is taken from all probes: their mean
/// line in pieces of equal numbers of probes. A row that another light was on is off as a whole.
fn out_of_sync(before: &Seen, now: &Seen, full: f64, height: u32) -> Option<Warning> {
    let (short, long) =
        if before.exposure_s < now.exposure_s { (before, now) } else { (now, before) };
    let both = short.probes.iter().zip(&long.probes).enumerate();
    let mut points: Vec<(usize, f64, f64)> = both
        .filter_map(|(i, (a, b))| Some((i / PROBES[0], f64::from((*a)?), f64::from((*b)?))))
        .filter(|(_, a, b)| b - long.min > LEAST_BRIGHT_ROW * full && b > a)
        .collect();
    points.sort_by(|p, q| p.1.total_cmp(&q.1));
    // Sums of deviations and of their variance, and the number of probes, of each row.
    let mut rows = vec![(0.0, 0.0, 0_u32); PROBES[1]];
    let narrow = |piece: &&[(usize, f64, f64)]| {
        let ends = piece.first().zip(piece.last());
        piece.len() == PIECE && ends.is_some_and(|(first, last)| last.1 < WIDEST * first.1)
    };
    for piece in points.chunks(PIECE).filter(narrow) {
        let n = PIECE as f64;
        let mean = |of: &dyn Fn(&(usize, f64, f64)) -> f64| piece.iter().map(of).sum::<f64>() / n;
        let (x, y) = (mean(&|p| p.1), mean(&|p| p.2));
        let (xx, xy) = (mean(&|p| (p.1 - x).powi(2)), mean(&|p| (p.1 - x) * (p.2 - y)));
        // An even picture has no slope to find.
        let slope = if xx > 1.0 { xy / xx } else { 0.0 };
        let off = |p: &(usize, f64, f64)| (p.2 - y - slope * (p.1 - x)) / (y - long.min).max(1.0);
        let mut scatter: Vec<f64> = piece.iter().map(|p| off(p).abs()).collect();
        scatter.sort_by(f64::total_cmp);
        // Of a normal distribution, of which a few values may be anything; a frame without any
        // noise still has steps.
        let sigma = (scatter[PIECE / 2] / 0.6745).max(1e-4);
        for p in piece {
            let row = &mut rows[p.0];
            row.0 += off(p);
            row.1 += sigma * sigma;
            row.2 += 1;
        }
    }
    let off = |row: usize| rows[row].0 / f64::from(rows[row].2);
    let worst = (0..PROBES[1])
        .filter(|&row| rows[row].2 >= LEAST_PROBES)
        .max_by(|&a, &b| off(a).abs().total_cmp(&off(b).abs()))?;
    let change = off(worst);
    // One of 64 rows of some hundred frames is 4 sigma off by chance.
    let significant = rows[worst].0.abs() > 6.0 * rows[worst].1.sqrt();
    let height = height as usize;
    (change.abs() > MOST_UNSYNCED && significant)
        .then(|| Warning::OutOfSync { row: probed(worst, PROBES[1], height) as u32, change })
}
