//! A plane's projective map around one point, from many pixels, some of them wrong.

use nalgebra::{SMatrix, SVector};

/// A pixel that says one coordinate of its image: near the point, in windows from it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Equation {
    /// From the point, in half windows.
    pub(crate) at: [f64; 2],
    /// 0 or 1: which coordinate.
    pub(crate) axis: usize,
    /// What it is.
    pub(crate) value: f64,
}

/// The image of the point itself.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LocalFit {
    pub(crate) image: [f64; 2],
    /// ∂(image)/∂(place), per half window, row by row.
    pub(crate) slope: [[f64; 2]; 2],
    pub(crate) sigma: [f64; 2],
    /// Root of the mean squared residual of an equation that counts fully.
    pub(crate) rms: f64,
    /// Equations that count at least half.
    pub(crate) used: usize,
}

type Normal = SMatrix<f64, 8, 8>;
type Unknowns = SVector<f64, 8>;

/// Residuals beyond this many times their scale count less and less (Huber 1964).
const HUBER: f64 = 1.5;
const ROUNDS: usize = 12;
/// Tiles along each edge of the window; errors are taken to be unrelated between tiles only.
const TILES: usize = 4;

/// Fits u = (h₀x + h₁y + h₂)/(1 + h₆x + h₇y), v likewise, by robust least squares: Gauss–Newton
/// with Huber's weights, their scale from the median residual.
///
/// The point's 1-sigma comes from the scatter of the tiles' gradients (a "sandwich"): pixels that
/// share an edge of a stripe share its error, which a sum over all pixels would take for noise.
///
/// `None` if the equations do not determine the map.
pub(crate) fn fit(equations: &[Equation]) -> Option<LocalFit> {
    let mut h = start(equations)?;
    let mut scale = f64::INFINITY;
    let mut normal = Normal::zeros();
    for _ in 0..ROUNDS {
        let mut residuals: Vec<f64> = equations.iter().map(|e| residual(&h, e).abs()).collect();
        let middle = residuals.len() / 2;
        // 1.4826: from the median of |r| to the standard deviation of a normal r.
        scale = (1.4826 * *residuals.select_nth_unstable_by(middle, f64::total_cmp).1).max(1e-6);
        normal = Normal::zeros();
        let mut gradient = Unknowns::zeros();
        for e in equations {
            let (r, j, places) = linear(&h, e);
            let w = weight(r, scale);
            for (a, &at) in places.iter().enumerate() {
                gradient[at] += w * r * j[a];
                for (b, &bt) in places.iter().enumerate() {
                    normal[(at, bt)] += w * j[a] * j[b];
                }
            }
        }
        let step = normal.cholesky()?.solve(&gradient);
        h -= step;
        // A thousandth of what the noise leaves undetermined.
        if step.amax() < 1e-3 * scale / (equations.len() as f64).sqrt() {
            break;
        }
    }
    let inverse = normal.cholesky()?.inverse();
    let mut tiles = [Unknowns::zeros(); TILES * TILES];
    let (mut squares, mut weights, mut used) = (0.0, 0.0, 0);
    for e in equations {
        let (r, j, places) = linear(&h, e);
        let w = weight(r, scale);
        squares += w * r * r;
        weights += w;
        used += usize::from(w >= 0.5);
        let tile = |v: f64| (((v + 1.0) / 2.0 * TILES as f64).max(0.0) as usize).min(TILES - 1);
        let sum = &mut tiles[tile(e.at[1]) * TILES + tile(e.at[0])];
        places.iter().zip(j).for_each(|(&at, j)| sum[at] += w * r * j);
    }
    let scatter: Normal = tiles.iter().map(|g| g * g.transpose()).sum();
    // Eight unknowns were fitted to sixteen tiles.
    let inflation = (TILES * TILES) as f64 / (TILES * TILES - 8) as f64;
    let covariance = inverse * scatter * inverse * inflation;
    Some(LocalFit {
        image: [h[2], h[5]],
        slope: [2, 5].map(|k| [h[k - 2] - h[k] * h[6], h[k - 1] - h[k] * h[7]]),
        sigma: [2, 5].map(|i| covariance[(i, i)].max(0.0).sqrt()),
        rms: (squares / weights).sqrt(),
        used,
    })
}

/// The affine map, each coordinate fitted to what lies near its median: a first wild value does
/// not spoil it.
fn start(equations: &[Equation]) -> Option<Unknowns> {
    let mut h = Unknowns::zeros();
    for axis in 0..2 {
        let own: Vec<&Equation> = equations.iter().filter(|e| e.axis == axis).collect();
        let mut values: Vec<f64> = own.iter().map(|e| e.value).collect();
        if values.len() < 8 {
            return None;
        }
        let place = values.len() / 2;
        let median = *values.select_nth_unstable_by(place, f64::total_cmp).1;
        let mut spread: Vec<f64> = values.iter().map(|v| (v - median).abs()).collect();
        // Within a window whose values run evenly from -s to s the median distance is s/2.
        let reach = 3.0 * *spread.select_nth_unstable_by(place, f64::total_cmp).1 + 1.0;
        let mut normal = SMatrix::<f64, 3, 3>::zeros();
        let mut right = SVector::<f64, 3>::zeros();
        for e in own.iter().filter(|e| (e.value - median).abs() <= reach) {
            let row = SVector::<f64, 3>::new(e.at[0], e.at[1], 1.0);
            normal += row * row.transpose();
            right += row * e.value;
        }
        let solved = normal.cholesky()?.solve(&right);
        h.fixed_rows_mut::<3>(3 * axis).copy_from(&solved);
    }
    Some(h)
}

fn weight(residual: f64, scale: f64) -> f64 {
    (HUBER * scale / residual.abs()).min(1.0)
}

fn residual(h: &Unknowns, e: &Equation) -> f64 {
    linear(h, e).0
}

/// Residual, its derivatives, and by which unknowns.
fn linear(h: &Unknowns, e: &Equation) -> (f64, [f64; 5], [usize; 5]) {
    let [x, y] = e.at;
    let k = 3 * e.axis;
    let below = 1.0 + h[6] * x + h[7] * y;
    let value = (h[k] * x + h[k + 1] * y + h[k + 2]) / below;
    let j = [x / below, y / below, 1.0 / below, -value * x / below, -value * y / below];
    (value - e.value, j, [k, k + 1, k + 2, 6, 7])
}
