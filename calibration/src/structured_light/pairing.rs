//! Which exchange of two pictures would make each go with its inverse.

use crate::structured_light::samples::Samples;

/// An exchange is believed if it brings the misfit of the pairs that it touches below one so
/// manieth. Of a sequence in order none lowers it at all.
const MENDED: f64 = 4.0;
/// Exchanges that lower the misfit by as much, to this factor, mend equally well.
const AS_WELL: f64 = 1.1;
/// Mean squared misfit of a pair that is of no importance: a hundredth of the light everywhere.
const FLOOR: f64 = 1e-4;

/// How badly any two pictures go together as one and its inverse.
///
/// A picture plus its inverse is all light plus none, whatever the blur, at each pixel: so much for
/// all pairs of a sequence. Misfit is the mean square of what a sum differs from the median over
/// the pairs by, as a share of the pixel's range.
pub(crate) struct Pairing {
    pictures: usize,
    /// Of pictures a and b at a · pictures + b.
    misfit: Vec<f64>,
}

impl Pairing {
    pub(crate) fn of(samples: &Samples) -> Self {
        let n = samples.pictures();
        let mut misfit = vec![0.0_f64; n * n];
        for shares in &samples.shares {
            let mut sums: Vec<f32> = shares.chunks_exact(2).map(|pair| pair[0] + pair[1]).collect();
            let middle = sums.len() / 2;
            let whole = *sums.select_nth_unstable_by(middle, f32::total_cmp).1;
            for a in 0..n {
                for b in a + 1..n {
                    let off = (shares[a] + shares[b] - whole).clamp(-1.0, 1.0);
                    misfit[a * n + b] += f64::from(off * off);
                }
            }
        }
        let lit = samples.lit().max(1) as f64;
        for a in 0..n {
            for b in a + 1..n {
                let mean = misfit[a * n + b] / lit;
                misfit[a * n + b] = mean;
                misfit[b * n + a] = mean;
            }
        }
        Self { pictures: n, misfit }
    }

    fn of_pair(&self, order: &[usize], at: usize) -> f64 {
        self.misfit[order[at] * self.pictures + order[at + 1]] + FLOOR
    }

    /// The exchanges of two pictures of different pairs that mend the sequence, all that do it
    /// equally well; none if it wants no mending, or one exchange does not do it.
    pub(crate) fn exchanges(&self, samples: &Samples) -> Vec<(usize, usize)> {
        let mut order: Vec<usize> = (0..self.pictures).collect();
        let last = self.pictures.saturating_sub(2);
        let mut found: Vec<(f64, (usize, usize))> = Vec::new();
        for a in 0..self.pictures {
            for b in (a | 1) + 1..self.pictures {
                let pairs = [a & !1, b & !1];
                let misfit =
                    |order: &[usize]| pairs.iter().map(|&at| self.of_pair(order, at)).sum::<f64>();
                let before = misfit(&order);
                order.swap(a, b);
                let after = misfit(&order);
                let lit = samples.brighter(order[last], order[last + 1]);
                order.swap(a, b);
                if after * MENDED < before && lit {
                    found.push((before - after, (a, b)));
                }
            }
        }
        let most = found.iter().map(|f| f.0).fold(0.0, f64::max);
        found.into_iter().filter(|f| f.0 * AS_WELL > most).map(|f| f.1).collect()
    }
}
