//! Contour lines of a function on a grid.

/// A piece of a contour, in grid coordinates.
pub(super) type Piece = [[f64; 2]; 2];

/// The pieces of the line where the bilinear function through `values` on `columns` x `rows`
/// points has the value `level` (marching squares; a saddle is cut the one way or the other).
pub(super) fn contour([columns, rows]: [usize; 2], values: &[f64], level: f64) -> Vec<Piece> {
    let at = |x: usize, y: usize| values.get(y * columns + x).copied().unwrap_or(f64::NAN);
    let mut out = Vec::new();
    for y in 0..rows.saturating_sub(1) {
        for x in 0..columns.saturating_sub(1) {
            // Around the cell; each side is crossed where its ends lie on two sides of the level.
            let corners = [[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]];
            let crossing = |i: usize| {
                let ([ax, ay], [bx, by]) = (corners[i], corners[(i + 1) % 4]);
                let (a, b) = (at(ax, ay) - level, at(bx, by) - level);
                ((a < 0.0) != (b < 0.0)).then(|| {
                    let t = a / (a - b);
                    let between = |p: usize, q: usize| p as f64 + t * (q as f64 - p as f64);
                    [between(ax, bx), between(ay, by)]
                })
            };
            let crossings: Vec<[f64; 2]> = (0..4).filter_map(crossing).collect();
            out.extend(crossings.chunks_exact(2).map(|pair| [pair[0], pair[1]]));
        }
    }
    out
}

/// 1, 2, 5, 10 … between two positive values, the ends left out.
pub(super) fn levels(low: f64, high: f64) -> Vec<f64> {
    if !(low > 0.0 && high.is_finite()) {
        return Vec::new();
    }
    let first = low.log10().floor() as i32;
    let last = high.log10().ceil() as i32;
    (first..=last)
        .flat_map(|power| [1.0, 2.0, 5.0].map(|s| s * 10f64.powi(power)))
        .filter(|level| *level > low && *level < high)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slope_has_a_straight_contour() {
        // f = x on 4 x 3 points: the contour of 1.5 runs down at x = 1.5, one piece a row of cells.
        let values: Vec<f64> = (0..12).map(|i| f64::from(i % 4)).collect();
        let pieces = contour([4, 3], &values, 1.5);
        assert_eq!(pieces.len(), 2);
        assert!(pieces.iter().flatten().all(|p| (p[0] - 1.5).abs() < 1e-12));
        assert!(contour([4, 3], &values, 7.0).is_empty());
    }

    #[test]
    fn levels_are_round() {
        let shown: Vec<String> = levels(0.07, 1.5).iter().map(|l| format!("{l:.2}")).collect();
        assert_eq!(shown, ["0.10", "0.20", "0.50", "1.00"]);
        assert!(levels(0.0, 1.0).is_empty() && levels(1.0, f64::INFINITY).is_empty());
    }
}
