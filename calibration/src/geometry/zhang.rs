//! A camera and its poses from plane projective maps alone: Zhang (2000), section 3.1.
//!
//! A start for the bundle adjustment, without lens distortion.

use nalgebra::{DMatrix, Matrix3, Rotation3, Vector3};

use crate::error::{CalibrationError, Result};
use crate::geometry::camera::View;
use crate::geometry::camera_model::CameraModel;
use crate::geometry::pose::Pose;
use crate::median::median;

/// Change of depth across a board, relative to its distance, below which it counts as parallel to
/// the sensor: what a corner found 0.3 px wrong does to a board 100 px wide.
const LEAST_FORESHORTENING: f64 = 0.01;

/// Half of a board's points lie within this share of its size of where a plane map has them: the
/// strongest lens bends less. In another order they lie anywhere.
const MOST_APART: f64 = 0.15;

/// Camera of `size` pixels and the pose of each view's board.
///
/// # Errors
/// Boards that are all parallel to the sensor, or to each other: they leave the focal length open.
pub(crate) fn closed_form(views: &[View], size: [usize; 2]) -> Result<(CameraModel, Vec<Pose>)> {
    let degenerate =
        |reason: String| CalibrationError::Degenerate { what: "camera calibration", reason };
    // Pixels about the middle in units of the picture's size: numbers near 1 keep digits.
    let middle = [0, 1].map(|a| (size[a] as f64 - 1.0) / 2.0);
    let unit = size[0].max(size[1]) as f64 / 2.0;
    let maps = views
        .iter()
        .map(|view| {
            let from: Vec<[f64; 2]> = view.object_points.iter().map(|p| [p[0], p[1]]).collect();
            let to: Vec<[f64; 2]> = view
                .image_points
                .iter()
                .map(|p| [0, 1].map(|a| (p[a] - middle[a]) / unit))
                .collect();
            plane_map(&from, &to).ok_or_else(|| CalibrationError::Degenerate {
                what: "camera calibration",
                reason: format!("{}: its points lie on one line", view.name),
            })
        })
        .collect::<Result<Vec<_>>>()?;
    for (view, map) in views.iter().zip(&maps) {
        let (off, across) = apart(view, map, middle, unit);
        if off > MOST_APART * across {
            return Err(CalibrationError::Mismatch {
                picture: view.name.clone(),
                expected: "points of a plane in the order of its places".into(),
                found: format!(
                    "half of them {off:.0} px or more from where any view of the plane has them: \
                     another order?"
                ),
            });
        }
    }
    let steepest = views.iter().zip(&maps).map(|(v, h)| foreshortening(v, h)).fold(0.0, f64::max);
    if steepest < LEAST_FORESHORTENING {
        return Err(degenerate(format!(
            "all boards are parallel to the sensor (depth changes by at most {:.1} % across a board)",
            100.0 * steepest
        )));
    }
    let k = intrinsics(&maps)
        .or_else(|| centred_intrinsics(&maps))
        .ok_or_else(|| degenerate("the boards are all parallel to each other".into()))?;
    let poses = maps.iter().map(|h| pose(&k, h)).collect::<Option<Vec<_>>>();
    let poses = poses.ok_or_else(|| degenerate("a board is seen edge on".into()))?;
    let focal = [unit * k[(0, 0)], unit * k[(1, 1)]];
    let centre = [unit * k[(0, 2)] + middle[0], unit * k[(1, 2)] + middle[1]];
    Ok((CameraModel::pinhole(size, focal, centre), poses))
}

/// How far from their places under a map half of a view's points are, and how far from their
/// middle, pixels.
fn apart(view: &View, h: &Matrix3<f64>, middle: [f64; 2], unit: f64) -> (f64, f64) {
    let n = view.image_points.len().max(1) as f64;
    let mean = [0, 1].map(|a| view.image_points.iter().map(|p| p[a]).sum::<f64>() / n);
    let (mut off, mut across) = (Vec::new(), Vec::new());
    for (place, p) in view.object_points.iter().zip(&view.image_points) {
        let q = h * Vector3::new(place[0], place[1], 1.0);
        let seen = [0, 1].map(|a| unit * q[a] / q[2] + middle[a]);
        off.push((seen[0] - p[0]).hypot(seen[1] - p[1]));
        across.push((p[0] - mean[0]).hypot(p[1] - mean[1]));
    }
    (median(&mut off).unwrap_or(0.0), median(&mut across).unwrap_or(0.0))
}

/// The plane projective map from `from` to `to` with the least algebraic error on centred, scaled
/// points (Hartley 1997); None for points on a line.
pub(crate) fn plane_map(from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Matrix3<f64>> {
    let (t, u) = (centring(from)?, centring(to)?);
    let place = |m: &Matrix3<f64>, p: &[f64; 2]| m * Vector3::new(p[0], p[1], 1.0);
    let mut normal = DMatrix::<f64>::zeros(9, 9);
    for (p, q) in from.iter().zip(to) {
        let (p, q) = (place(&t, p), place(&u, q));
        for a in 0..2 {
            let mut row = [0.0; 9];
            for i in 0..3 {
                row[3 * a + i] = p[i];
                row[6 + i] = -q[a] * p[i];
            }
            for i in 0..9 {
                for j in 0..9 {
                    normal[(i, j)] += row[i] * row[j];
                }
            }
        }
    }
    let h = least_eigenvector(normal)?;
    let h = Matrix3::from_fn(|i, j| h[3 * i + j]);
    let out = u.try_inverse()? * h * t;
    // In front of the camera the last row is positive.
    let sign = if out[(2, 2)] < 0.0 { -1.0 } else { 1.0 };
    let out = out * sign;
    out.iter().all(|v| v.is_finite()).then_some(out)
}

/// Moves points to mean 0 and mean square 1.
fn centring(points: &[[f64; 2]]) -> Option<Matrix3<f64>> {
    let n = points.len() as f64;
    let middle = [0, 1].map(|a| points.iter().map(|p| p[a]).sum::<f64>() / n);
    let squares: f64 =
        points.iter().map(|p| (p[0] - middle[0]).powi(2) + (p[1] - middle[1]).powi(2)).sum();
    let s = (squares / n).sqrt().recip();
    s.is_finite()
        .then(|| Matrix3::new(s, 0.0, -s * middle[0], 0.0, s, -s * middle[1], 0.0, 0.0, 1.0))
}

/// Eigenvector of the smallest eigenvalue; None where the next one is as small.
fn least_eigenvector(normal: DMatrix<f64>) -> Option<Vec<f64>> {
    let eigen = normal.symmetric_eigen();
    let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    let (&first, &second, &last) = (order.first()?, order.get(1)?, order.last()?);
    (eigen.eigenvalues[second] > 1e-12 * eigen.eigenvalues[last])
        .then(|| eigen.eigenvectors.column(first).iter().copied().collect())
}

/// Largest change of depth across a board, relative to its least depth.
fn foreshortening(view: &View, h: &Matrix3<f64>) -> f64 {
    let depths = view.object_points.iter().map(|p| h[(2, 0)] * p[0] + h[(2, 1)] * p[1] + h[(2, 2)]);
    let (least, most) =
        depths.fold((f64::MAX, f64::MIN), |(low, high), d| (low.min(d), high.max(d)));
    if least > 0.0 { most / least - 1.0 } else { f64::INFINITY }
}

/// Zhang's linear solution for B = K⁻ᵀ K⁻¹ without skew.
fn intrinsics(maps: &[Matrix3<f64>]) -> Option<Matrix3<f64>> {
    // b = (B11, B22, B13, B23, B33).
    let row = |h: &Matrix3<f64>, i: usize, j: usize| {
        let (a, b) = (h.column(i), h.column(j));
        [
            a[0] * b[0],
            a[1] * b[1],
            a[2] * b[0] + a[0] * b[2],
            a[2] * b[1] + a[1] * b[2],
            a[2] * b[2],
        ]
    };
    let [b11, b22, b13, b23, b33]: [f64; 5] =
        constraints(maps, row).and_then(|b| b.try_into().ok())?;
    let (cx, cy) = (-b13 / b11, -b23 / b22);
    let scale = b33 - b13 * b13 / b11 - b23 * b23 / b22;
    upper(scale / b11, scale / b22, cx, cy)
}

/// As [`intrinsics`] with the principal point in the middle: fewer unknowns where views are few.
fn centred_intrinsics(maps: &[Matrix3<f64>]) -> Option<Matrix3<f64>> {
    let row = |h: &Matrix3<f64>, i: usize, j: usize| {
        let (a, b) = (h.column(i), h.column(j));
        [a[0] * b[0], a[1] * b[1], a[2] * b[2]]
    };
    let [b11, b22, b33]: [f64; 3] = constraints(maps, row).and_then(|b| b.try_into().ok())?;
    upper(b33 / b11, b33 / b22, 0.0, 0.0)
}

/// The vector that satisfies best what every map says: its columns are at right angles and of
/// equal length in the plane's frame.
fn constraints<const N: usize>(
    maps: &[Matrix3<f64>],
    row: impl Fn(&Matrix3<f64>, usize, usize) -> [f64; N],
) -> Option<Vec<f64>> {
    let mut normal = DMatrix::<f64>::zeros(N, N);
    for h in maps {
        let h = h / h.column(0).norm().max(h.column(1).norm());
        let (across, first, second) = (row(&h, 0, 1), row(&h, 0, 0), row(&h, 1, 1));
        let equal: [f64; N] = std::array::from_fn(|i| first[i] - second[i]);
        for v in [across, equal] {
            for i in 0..N {
                for j in 0..N {
                    normal[(i, j)] += v[i] * v[j];
                }
            }
        }
    }
    least_eigenvector(normal)
}

fn upper(fx2: f64, fy2: f64, cx: f64, cy: f64) -> Option<Matrix3<f64>> {
    // A field of view between 1 and 160 degrees, and a principal point not far outside.
    let plausible = |f2: f64| f2.is_finite() && (0.03..1e4).contains(&f2);
    (plausible(fx2) && plausible(fy2) && cx.abs() < 3.0 && cy.abs() < 3.0)
        .then(|| Matrix3::new(fx2.sqrt(), 0.0, cx, 0.0, fy2.sqrt(), cy, 0.0, 0.0, 1.0))
}

/// Zhang's pose of a plane from its map.
pub(crate) fn pose(k: &Matrix3<f64>, h: &Matrix3<f64>) -> Option<Pose> {
    let m = k.try_inverse()? * h;
    let scale = 2.0 / (m.column(0).norm() + m.column(1).norm());
    let sign = if m[(2, 2)] < 0.0 { -scale } else { scale };
    let m = m * sign;
    let (x, y) = (m.column(0).into_owned(), m.column(1).into_owned());
    let rough = Matrix3::from_columns(&[x, y, x.cross(&y)]);
    let svd = rough.svd(true, true);
    let rotation = svd.u? * svd.v_t?;
    let rotation = Rotation3::from_matrix_unchecked(rotation).into_inner();
    let out = Pose::from_parts(&rotation, &m.column(2).into_owned());
    (rotation.determinant() > 0.0).then_some(out)
}
