//! Which exposures of a bracket a picture needs, once one like it has been seen.
//!
//! A bracket from 1/30 to 8 s serves any block. This one needs less: where the longest exposures
//! are clipped almost everywhere, or make nothing better than it has to be, they only cost time.

use serde::{Deserialize, Serialize};

/// What a sensor does to the light of one channel, in linearised full scales.
///
/// A pixel of radiance L full scales a second, exposed for t seconds, has the signal s = L t with
/// variance dark² + photons · s, up to `saturation`; beyond it says nothing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameNoise {
    /// Standard deviation without light, quantisation included, full scales; positive.
    pub dark: f64,
    /// Variance for each full scale of signal: one over the electrons that fill a pixel.
    pub photons: f64,
    /// Signal from which on codes say nothing but "more", full scales; positive.
    pub saturation: f64,
}

impl FrameNoise {
    /// One over the variance of the radiance that one frame of `exposure_s` seconds tells, 0 where
    /// it is clipped. Frames add up, as in a merge that weights them by it.
    pub fn information(&self, radiance: f64, exposure_s: f64) -> f64 {
        let signal = radiance.max(0.0) * exposure_s;
        if signal > self.saturation {
            return 0.0;
        }
        exposure_s * exposure_s / (self.dark * self.dark + self.photons * signal)
    }
}

/// What one channel of the picture looked like.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelBrightness {
    /// Its noise.
    pub noise: FrameNoise,
    /// Radiance of each place that counts, full scales a second, dark current and all; below 0
    /// counts as 0.
    pub radiances: Vec<f64>,
    /// Standard deviation of a pixel's radiance that comes from elsewhere and stays, whatever the
    /// exposures: what the solver adds for its model's error. Full scales a second; 0 if there is
    /// none.
    pub floor: f64,
}

/// What the chosen exposures have to reach.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NoiseGoal {
    /// Largest standard deviation, floor included, over that of the whole bracket; at least 1.
    pub tolerance: f64,
    /// Share of the places, the brightest of each channel, that need not reach it: 0 to below 1.
    pub left_out: f64,
    /// How many times brighter than this picture others may be and still reach it; at least 1.
    pub head_room: f64,
}

/// The exposures that were chosen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ExposureChoice {
    /// From the shortest to the longest, seconds; each one of the bracket.
    pub exposures_s: Vec<f64>,
    /// Time that they take, with what each frame takes beside its exposure, seconds.
    pub time_s: f64,
    /// Time that the whole bracket takes, seconds.
    pub bracket_time_s: f64,
    /// Largest standard deviation, floor included, over that of the whole bracket.
    pub worst: f64,
}

/// Why nothing can be chosen.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ExposureChoiceError {
    /// A bracket that is none.
    #[error("a bracket needs exposure times that are positive and finite, found {0:?} s")]
    Bracket(Vec<f64>),
    /// A figure that makes no sense.
    #[error("{what}: expected {expected}, found {found}")]
    Figure {
        /// Which.
        what: &'static str,
        /// What would do.
        expected: &'static str,
        /// What is there.
        found: f64,
    },
    /// A picture without a place that the bracket can measure.
    #[error(
        "no place of the picture can be measured: all are masked, or clipped in every exposure of the bracket"
    )]
    NothingToSee,
}

/// Radiances that stand for all of a channel's: evenly spaced in stops.
const CLASSES: usize = 48;
/// Radiances between the brightest and what head-room asks for.
const ABOVE: usize = 6;
/// Frames at least: a merge compares exposures with one another.
const FEWEST: usize = 2;
/// Rounding of the sums of information.
const ROUNDING: f64 = 1e-9;

/// Chooses, of `bracket_s`, the exposures with the least total time (each costs itself and
/// `per_frame_s`) for which every place's standard deviation reaches `goal`.
///
/// Radiances are merged with the variances' inverse as weight, so that of n frames is
/// 1/Σ information. The search is exact, over the brightness classes that stand for the places:
/// exposures are taken or left one by one, and a branch ends where even all that are left would
/// not do, or where the least time that they could do in is not below the best found. Two frames
/// are taken at least, where the bracket has two.
///
/// # Errors
/// See [`ExposureChoiceError`]. There is always a choice otherwise: the whole bracket.
pub fn choose_exposures(
    channels: &[ChannelBrightness],
    bracket_s: &[f64],
    per_frame_s: f64,
    goal: &NoiseGoal,
) -> Result<ExposureChoice, ExposureChoiceError> {
    let mut times = bracket_s.to_vec();
    times.sort_by(|a, b| b.total_cmp(a));
    times.dedup();
    if times.is_empty() || times.iter().any(|t| !(t.is_finite() && *t > 0.0)) {
        return Err(ExposureChoiceError::Bracket(bracket_s.to_vec()));
    }
    check(channels, per_frame_s, goal)?;
    let places: Vec<Place> = channels.iter().flat_map(|c| places(c, &times, goal)).collect();
    if places.is_empty() {
        return Err(ExposureChoiceError::NothingToSee);
    }
    let cost: Vec<f64> = times.iter().map(|t| t + per_frame_s).collect();
    let mut search = Search::new(&places, &cost);
    search.go(0, 0.0);
    let taken = search.best;
    let chosen: Vec<usize> = (0..times.len()).filter(|&k| taken[k]).collect();
    let worst = |p: &Place| {
        let sum: f64 = chosen.iter().map(|&k| p.information[k]).sum();
        ((1.0 / sum + p.floor * p.floor) / p.bracket_variance).sqrt()
    };
    Ok(ExposureChoice {
        exposures_s: chosen.iter().rev().map(|&k| times[k]).collect(),
        time_s: chosen.iter().map(|&k| cost[k]).sum(),
        bracket_time_s: cost.iter().sum(),
        worst: places.iter().map(worst).fold(0.0, f64::max),
    })
}

fn check(
    channels: &[ChannelBrightness],
    per_frame_s: f64,
    goal: &NoiseGoal,
) -> Result<(), ExposureChoiceError> {
    const POSITIVE: &str = "a positive number";
    const NOT_NEGATIVE: &str = "a number not below 0";
    let figure = |what, expected, found: f64, good: bool| {
        if good && found.is_finite() {
            Ok(())
        } else {
            Err(ExposureChoiceError::Figure { what, expected, found })
        }
    };
    figure("time per frame", NOT_NEGATIVE, per_frame_s, per_frame_s >= 0.0)?;
    figure("tolerance", "at least 1", goal.tolerance, goal.tolerance >= 1.0)?;
    figure("head-room", "at least 1", goal.head_room, goal.head_room >= 1.0)?;
    let share = (0.0..1.0).contains(&goal.left_out);
    figure("share left out", "0 to below 1", goal.left_out, share)?;
    for ChannelBrightness { noise, floor, .. } in channels {
        figure("noise without light", POSITIVE, noise.dark, noise.dark > 0.0)?;
        figure("noise of photons", NOT_NEGATIVE, noise.photons, noise.photons >= 0.0)?;
        figure("saturation", POSITIVE, noise.saturation, noise.saturation > 0.0)?;
        figure("floor", NOT_NEGATIVE, *floor, *floor >= 0.0)?;
    }
    Ok(())
}

/// A radiance, and what each exposure tells of it.
struct Place {
    /// By exposure, from the longest to the shortest.
    information: Vec<f64>,
    /// What the chosen ones have to add up to.
    needed: f64,
    floor: f64,
    /// With the whole bracket, floor included.
    bracket_variance: f64,
}

/// The radiances that stand for a channel's, where the bracket sees them at all.
fn places(channel: &ChannelBrightness, times: &[f64], goal: &NoiseGoal) -> Vec<Place> {
    let mut sorted: Vec<f64> =
        channel.radiances.iter().filter(|l| l.is_finite()).map(|l| l.max(0.0)).collect();
    sorted.sort_by(f64::total_cmp);
    let kept = sorted.len() - (goal.left_out * sorted.len() as f64).floor() as usize;
    let (Some(&low), Some(&high)) = (sorted.first(), sorted[..kept].last()) else {
        return Vec::new();
    };
    // Below a hundredth of the noise of the longest exposure all radiances are dark alike.
    let dark = 0.01 * channel.noise.dark / times[0];
    let stops = |low: f64, high: f64, n: usize| {
        let ratio = high.max(dark) / low.max(dark);
        (1..=n).map(move |i| low.max(dark) * ratio.powf(i as f64 / n as f64))
    };
    let radiances = std::iter::once(low).chain(stops(low, high, CLASSES)).chain(stops(
        high,
        high * goal.head_room,
        ABOVE,
    ));
    let floor = channel.floor;
    let place = |radiance: f64| {
        let information: Vec<f64> =
            times.iter().map(|&t| channel.noise.information(radiance, t)).collect();
        let bracket_variance = 1.0 / information.iter().sum::<f64>() + floor * floor;
        let allowed = goal.tolerance.powi(2) * bracket_variance - floor * floor;
        let needed = (1.0 - ROUNDING) / allowed;
        bracket_variance.is_finite().then_some(Place {
            information,
            needed,
            floor,
            bracket_variance,
        })
    };
    radiances.filter_map(place).collect()
}

/// Exposures taken and left, from the longest to the shortest.
struct Search<'a> {
    places: &'a [Place],
    cost: &'a [f64],
    taken: Vec<bool>,
    /// What the taken ones tell of each place.
    known: Vec<f64>,
    /// `rest[k][place]`: what all exposures from k on tell.
    rest: Vec<Vec<f64>>,
    best: Vec<bool>,
    best_cost: f64,
}

impl<'a> Search<'a> {
    /// Begins with the whole bracket as the best.
    fn new(places: &'a [Place], cost: &'a [f64]) -> Self {
        let frames = cost.len();
        let mut rest = vec![vec![0.0; places.len()]; frames + 1];
        for k in (0..frames).rev() {
            let sums = rest[k + 1].iter().zip(places).map(|(sum, p)| sum + p.information[k]);
            rest[k] = sums.collect();
        }
        Self {
            places,
            cost,
            taken: vec![false; frames],
            known: vec![0.0; places.len()],
            rest,
            best: vec![true; frames],
            best_cost: cost.iter().sum(),
        }
    }

    /// Decides on exposure k and all after it, where those before took `spent` seconds.
    fn go(&mut self, k: usize, spent: f64) {
        let Some(least) = self.least_more(k) else { return };
        if spent + least >= self.best_cost {
            return;
        }
        if k == self.cost.len() {
            (self.best_cost, self.best) = (spent, self.taken.clone());
            return;
        }
        self.go(k + 1, spent);
        let before = self.known.clone();
        let told = self.known.iter_mut().zip(self.places);
        told.for_each(|(known, p)| *known += p.information[k]);
        self.taken[k] = true;
        self.go(k + 1, spent + self.cost[k]);
        self.taken[k] = false;
        self.known = before;
    }

    /// The least time that exposures from k on could still need, None where they cannot do: for
    /// the place that is worst off, as if what lacks could be had at the best rate there is.
    fn least_more(&self, k: usize) -> Option<f64> {
        let frames = self.taken.iter().filter(|t| **t).count();
        let lacking = FEWEST.min(self.cost.len()).saturating_sub(frames);
        if lacking > self.cost.len() - k {
            return None;
        }
        // The shortest come last.
        let mut least: f64 = self.cost[self.cost.len() - lacking..].iter().sum();
        for ((place, known), rest) in self.places.iter().zip(&self.known).zip(&self.rest[k]) {
            let lack = place.needed - known;
            if lack <= 0.0 {
                continue;
            }
            if *rest < lack {
                return None;
            }
            let rates = place.information[k..].iter().zip(&self.cost[k..]).map(|(i, c)| i / c);
            let one = self.cost[k..].iter().copied().fold(f64::INFINITY, f64::min);
            least = least.max(lack / rates.fold(0.0, f64::max)).max(one);
        }
        Some(least)
    }
}

#[cfg(test)]
mod tests;
