//! Which axes are halved on the way to coarser grids; the same on every device.

/// Grids with at most this many cells are solved directly: the inverse has 4096 entries, so
/// applying it costs less than one more level would.
pub(crate) const DIRECT_CELLS: usize = 64;

/// An axis is halved when its coupling is at least this share of the strongest. Below it, a
/// point smoother does not damp errors along the axis, and halving it would lose them
/// (semi-coarsening, the usual remedy for anisotropy).
const COUPLED: f64 = 0.35;

/// Cells of every level, finest first.
///
/// The coupling along an axis is that of a uniform block, 1/h². What a block's own κ adds to it
/// differs from place to place, and one choice has to do for all of it.
pub(crate) fn levels(cells: [usize; 3], spacing_mm: [f64; 3]) -> Vec<[usize; 3]> {
    let (mut cells, mut h) = (cells, spacing_mm);
    let mut out = vec![cells];
    while cells.iter().product::<usize>() > DIRECT_CELLS {
        let coupling = h.map(|h| 1.0 / (h * h));
        let strongest = (0..3).filter(|&a| cells[a] > 1).map(|a| coupling[a]).fold(0.0, f64::max);
        for a in 0..3 {
            if cells[a] > 1 && coupling[a] >= COUPLED * strongest {
                cells[a] = cells[a].div_ceil(2);
                h[a] *= 2.0;
            }
        }
        out.push(cells);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::levels;

    #[test]
    fn axes_are_halved_together_or_the_strongest_first() {
        let cubes = levels([256, 256, 20], [1.0; 3]);
        assert_eq!(cubes[1], [128, 128, 10]);
        assert_eq!(cubes.last(), Some(&[8, 8, 1]));
        // h = 0.2 along z couples 25 times as strongly, after one halving still 6 times.
        let flat = levels([64, 64, 64], [1.0, 1.0, 0.2]);
        assert_eq!(&flat[1..4], &[[64, 64, 32], [64, 64, 16], [32, 32, 8]]);
        assert_eq!(levels([4, 4, 4], [1.0; 3]).len(), 1);
    }
}
