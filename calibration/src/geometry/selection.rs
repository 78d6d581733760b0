//! Which distortion: the simplest that cross-validation supports.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::error::{CalibrationError, Result};
use crate::geometry::bundle::{self, Free, State};
use crate::geometry::calibrate::Adjustment;
use crate::geometry::camera_model::CameraModel;
use crate::geometry::distortion::Distortion;

/// Parts that the views are cut into; each is held out once.
const FOLDS: usize = 8;

/// Standard errors by which a richer model must explain held-out views better: at 2, one in forty
/// gets in by chance.
const SUPPORT: f64 = 2.0;

/// The distortion under which outliers are looked for before any is chosen: no lens is so far from
/// it that its good points are taken for outliers, and it is determined by few views.
const RICH: Distortion = Distortion::K1K2P1P2;

/// Fewest views for holding one out: the others must still make a calibration.
const FEWEST_TO_HOLD_OUT: usize = 4;

/// One distortion and how well it explains views that it was not fitted to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelTrial {
    /// The distortion.
    pub distortion: Distortion,
    /// sqrt(Σ(dx² + dy²)/N) over views that were held out in turn, pixels; only their poses were
    /// fitted. None where they were too few to hold one out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub held_out_px: Option<f64>,
    /// Why it is out of the question, if it is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refused: Option<String>,
}

/// How a device's distortion was chosen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Selection {
    /// The one that was taken.
    pub distortion: Distortion,
    /// The ones that were tried, the simplest first; empty where it was given.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub trials: Vec<ModelTrial>,
}

/// Solves `fit` under the wanted distortion, or under the simplest of `ladder` whose squared error
/// on held-out views exceeds the least by no more than two standard errors of the difference (after
/// Breiman et al. 1984, section 3.4.3, who take one).
///
/// # Errors
/// The wanted distortion does not converge or folds the picture; or all of them.
pub(crate) fn choose(
    fit: &mut Adjustment<'_>,
    wanted: Option<Distortion>,
    ladder: &[Distortion],
    set: impl Fn(&mut Free, Distortion),
    device: impl Fn(&State) -> &CameraModel,
) -> Result<Selection> {
    if let Some(distortion) = wanted {
        set(&mut fit.free, distortion);
        fit.settle()?;
        return match device(&fit.state).fold() {
            None => Ok(Selection { distortion, trials: Vec::new() }),
            Some([x, y]) => Err(CalibrationError::Folded {
                what: fit.what,
                distortion: distortion.name(),
                pixel: [x, y],
            }),
        };
    }
    // One corner in the wrong place would outweigh what the distortions differ by.
    let mut rich = fit.clone();
    set(&mut rich.free, RICH);
    if rich.weed().is_ok() {
        fit.left_out = rich.left_out;
    }
    let mut trials = Vec::new();
    let mut standing: Vec<(Distortion, Adjustment<'_>, Option<Vec<f64>>)> = Vec::new();
    for &distortion in ladder {
        let mut trial = fit.clone();
        if let Some((_, last, _)) = standing.last() {
            // The simpler solution is a good start.
            trial.state = last.state.clone();
        }
        set(&mut trial.free, distortion);
        let refused = match trial.settle() {
            Err(error @ CalibrationError::NotConverged { .. }) => Some(error.to_string()),
            Err(error) => return Err(error),
            Ok(()) => device(&trial.state)
                .fold()
                .map(|[x, y]| format!("folds the picture onto itself at ({x:.0}, {y:.0})")),
        };
        if refused.is_some() {
            trials.push(ModelTrial { distortion, held_out_px: None, refused });
            continue;
        }
        let squares = held_out(&trial)?;
        let held_out_px = squares.as_ref().map(|s| {
            let points: usize = fit.views.iter().map(|v| v.sights()).sum();
            (s.iter().sum::<f64>() / points.max(1) as f64).sqrt()
        });
        trials.push(ModelTrial { distortion, held_out_px, refused: None });
        standing.push((distortion, trial, squares));
    }
    let best = simplest(&standing.iter().map(|(_, _, s)| s.clone()).collect::<Vec<_>>());
    let Some(best) = best else {
        let reasons: Vec<String> = trials
            .iter()
            .filter_map(|t| Some(format!("{}: {}", t.distortion.name(), t.refused.as_ref()?)))
            .collect();
        return Err(CalibrationError::NotConverged { what: fit.what, reason: reasons.join("; ") });
    };
    let (distortion, solved, _) = standing.swap_remove(best);
    *fit = solved;
    Ok(Selection { distortion, trials })
}

/// Index of the simplest that is as good as the best, from each trial's squares by view.
fn simplest(trials: &[Option<Vec<f64>>]) -> Option<usize> {
    let known: Option<Vec<&Vec<f64>>> = trials.iter().map(Option::as_ref).collect();
    let Some(known) = known else {
        // Too few views to hold one out: one radial term at most, which every lens has.
        return trials.len().checked_sub(1).map(|last| last.min(1));
    };
    let total = |s: &[f64]| s.iter().sum::<f64>();
    let best = known.iter().copied().min_by(|a, b| total(a).total_cmp(&total(b)))?;
    known.iter().position(|squares| {
        let excess: Vec<f64> = squares.iter().zip(best).map(|(a, b)| a - b).collect();
        let n = excess.len() as f64;
        let mean = total(&excess) / n;
        let spread = excess.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
        mean * n <= SUPPORT * (n * spread).sqrt()
    })
}

/// Squared residuals of every view under a calibration that did not see it, pixels².
fn held_out(fit: &Adjustment<'_>) -> Result<Option<Vec<f64>>> {
    let n = fit.views.len();
    if n < FEWEST_TO_HOLD_OUT {
        return Ok(None);
    }
    let folds = FOLDS.min(n);
    let parts: Vec<Vec<(usize, f64)>> = (0..folds)
        .into_par_iter()
        .map(|fold| {
            let (out, kept): (Vec<usize>, Vec<usize>) = (0..n).partition(|v| v % folds == fold);
            fold_squares(fit, &kept, &out)
        })
        .collect::<Result<_>>()?;
    let mut squares = vec![0.0; n];
    parts.into_iter().flatten().for_each(|(view, sum)| squares[view] = sum);
    Ok(Some(squares))
}

/// Fits to the views `kept`; then the poses of those left `out`, whose squares are returned.
fn fold_squares(fit: &Adjustment<'_>, kept: &[usize], out: &[usize]) -> Result<Vec<(usize, f64)>> {
    let views = pick(fit.views, kept);
    let train = Adjustment {
        views: &views,
        left_out: pick(&fit.left_out, kept),
        state: State { poses: pick(&fit.state.poses, kept), ..fit.state.clone() },
        ..fit.clone()
    };
    let solved = bundle::solve(fit.what, &train.problem(f64::INFINITY), train.state.clone());
    let state = match solved {
        Ok(state) => state,
        // A model that falls apart without a few views explains them as badly as can be.
        Err(CalibrationError::NotConverged { .. }) => {
            return Ok(out.iter().map(|&view| (view, WORST)).collect());
        }
        Err(error) => return Err(error),
    };
    let views = pick(fit.views, out);
    let test = Adjustment {
        views: &views,
        left_out: pick(&fit.left_out, out),
        free: Free { camera: Vec::new(), projector: None, warp: false },
        state: State { poses: pick(&fit.state.poses, out), ..state },
        ..fit.clone()
    };
    let problem = test.problem(f64::INFINITY);
    let Ok(state) = bundle::solve(fit.what, &problem, test.state.clone()) else {
        return Ok(out.iter().map(|&view| (view, WORST)).collect());
    };
    let squares = out.iter().enumerate().map(|(i, &view)| {
        let all = bundle::residuals(&problem, &state, i);
        let sum =
            all.map_or(WORST, |all| all.iter().map(|r| r.px[0].powi(2) + r.px[1].powi(2)).sum());
        (view, sum)
    });
    Ok(squares.collect())
}

/// Squares of a view that a model cannot explain at all, pixels².
const WORST: f64 = 1e12;

fn pick<T: Clone>(all: &[T], which: &[usize]) -> Vec<T> {
    which.iter().map(|&i| all[i].clone()).collect()
}
