//! The knots of a response that is being recovered, and the algebra of its increments.

use std::sync::LazyLock;

use nalgebra::{DMatrix, DVector};

use crate::radiometry::response::KNOTS;

/// The knots whose increments are the unknowns: every code where a power law bends most, then
/// every fourth. Between them the curve is a straight line of ln exposure over ln(k + ½).
static KNOT_CODES: LazyLock<Vec<usize>> = LazyLock::new(|| {
    let codes = (0..16).chain((16..32).step_by(2)).chain((32..KNOTS - 4).step_by(4));
    codes.chain([KNOTS - 1]).collect()
});

fn place(code: usize) -> f64 {
    (code as f64 + 0.5).ln()
}

/// The two unknowns around each code and the code's share in the upper one.
static SHARES: LazyLock<Vec<(usize, f64)>> = LazyLock::new(|| {
    let shares = (0..KNOTS).map(|code| {
        let above = KNOT_CODES.partition_point(|k| *k <= code).clamp(1, KNOT_CODES.len() - 1);
        let (low, high) = (place(KNOT_CODES[above - 1]), place(KNOT_CODES[above]));
        (above - 1, (place(code) - low) / (high - low))
    });
    shares.collect()
});

/// From the curve at all codes to the increments d of the knots, with g(0) = 0: the form is
/// gathered on the knots, then summed from the top.
pub(crate) fn in_increments(h: &DMatrix<f64>, b: &DVector<f64>) -> (DMatrix<f64>, DVector<f64>) {
    let n = KNOT_CODES.len() - 1;
    let mut hd = DMatrix::zeros(n + 2, n + 2);
    let mut bd = DVector::zeros(n + 2);
    for (i, &(k, f)) in SHARES.iter().enumerate() {
        bd[k] += (1.0 - f) * b[i];
        bd[k + 1] += f * b[i];
        for (j, &(l, e)) in SHARES.iter().enumerate() {
            let value = h[(i, j)];
            if value != 0.0 {
                hd[(k, l)] += (1.0 - f) * (1.0 - e) * value;
                hd[(k + 1, l)] += f * (1.0 - e) * value;
                hd[(k, l + 1)] += (1.0 - f) * e * value;
                hd[(k + 1, l + 1)] += f * e * value;
            }
        }
    }
    for k in (0..n).rev() {
        bd[k + 1] += bd[k + 2];
        for l in 0..n + 2 {
            hd[(k + 1, l)] += hd[(k + 2, l)];
        }
    }
    for l in (0..n).rev() {
        for k in 0..n + 2 {
            hd[(k, l + 1)] += hd[(k, l + 2)];
        }
    }
    (hd.view((1, 1), (n, n)).into_owned(), bd.rows(1, n).into_owned())
}

/// The curve at all codes from the increments.
pub(crate) fn from_increments(d: &DVector<f64>) -> Vec<f64> {
    let mut log = 0.0;
    let rises = d.iter().map(|rise| {
        log += rise;
        log
    });
    let knots: Vec<f64> = std::iter::once(0.0).chain(rises).collect();
    SHARES.iter().map(|&(k, f)| knots[k] + f * (knots[k + 1] - knots[k])).collect()
}

/// ∫ (w d²g/du²)² du with u = ln(k + ½), as a quadratic form in the increments of g; w = 4c(1−c)
/// lets the curve bend where the data are few but toes and shoulders are, as Debevec's does.
pub(crate) fn curvature() -> DMatrix<f64> {
    let n = KNOT_CODES.len() - 1;
    let width = |k: usize| place(KNOT_CODES[k + 1]) - place(KNOT_CODES[k]);
    let mut form = DMatrix::zeros(n, n);
    for k in 0..n - 1 {
        let between = 0.5 * (width(k) + width(k + 1));
        let code = KNOT_CODES[k + 1] as f64 / (KNOTS - 1) as f64;
        let trust = 4.0 * code * (1.0 - code);
        let row = [(k, -1.0 / width(k)), (k + 1, 1.0 / width(k + 1))];
        for (i, a) in row {
            for (j, b) in row {
                form[(i, j)] += trust * trust * a * b / between;
            }
        }
    }
    form
}

/// How often the local gamma d ln exposure/d ln code turns between rising and falling, by more
/// than a twentieth, between 2 and 98 % of the range.
pub(crate) fn turns(d: &DVector<f64>) -> usize {
    let knots = KNOT_CODES.windows(2).zip(d.iter());
    let inside = knots.filter(|(k, _)| k[0] >= KNOTS / 50 && k[1] <= KNOTS - KNOTS / 50);
    let mut slopes = inside.map(|(k, rise)| rise / (place(k[1]) - place(k[0])));
    let Some(mut extreme) = slopes.next() else { return 0 };
    let (mut rising, mut turns) = (None, 0);
    for slope in slopes {
        let beyond = match rising {
            Some(true) => slope > extreme,
            Some(false) => slope < extreme,
            None => slope > 1.05 * extreme || slope < extreme / 1.05,
        };
        let back = match rising {
            Some(true) => slope < extreme / 1.05,
            Some(false) => slope > 1.05 * extreme,
            None => false,
        };
        if rising.is_none() && beyond {
            rising = Some(slope > extreme);
        }
        if back {
            turns += 1;
            rising = rising.map(|was| !was);
        }
        if beyond || back {
            extreme = slope;
        }
    }
    turns
}
