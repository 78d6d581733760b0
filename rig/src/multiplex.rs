//! Many regions lit at once, and the way back to one at a time.
//!
//! Where a camera's own noise rules, a picture of half of all regions is as noisy as a picture of
//! one, and holds half of all regions' light: each region is seen in half of the pictures. The
//! patterns are the rows of an S-matrix (Harwit and Sloane, Hadamard Transform Optics, 1979,
//! chapter 3): zeros and ones, S Sᵀ = (n + 1)/4 (I + J), J being all ones. Its inverse is
//! 2/(n + 1) (2 Sᵀ − J), so a region's value has the variance 4 n/(n + 1)² of one picture's.
//!
//! That holds where the noise does not grow with the light. Photons do: what they gain where a
//! region is bright they lose where it is dark, since the others' light comes with its noise.

/// A square matrix of zeros and ones that regions are lit by.
///
/// Row m tells which of `order` regions picture m lights. Where there are fewer regions, the last
/// columns belong to none.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SMatrix {
    order: usize,
    kind: Kind,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Kind {
    /// Order 2^k − 1, from Sylvester's Hadamard matrix: row and column, counted from 1, share an
    /// odd number of bits.
    Sylvester,
    /// A prime order, 3 modulo 4: column minus row is a square modulo the order (Paley). The
    /// squares and 0 are a difference set, so every two rows share (order + 1)/4 ones.
    Paley {
        /// Whether each number below the order is a square.
        squares: Vec<bool>,
    },
}

/// Regions that cannot be told apart from the pictures given.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DemultiplexError {
    /// Another number of pictures than the matrix has rows.
    #[error("expected {expected} pictures, one for each row of the matrix, found {found}")]
    Pictures {
        /// Rows of the matrix.
        expected: usize,
        /// Pictures given.
        found: usize,
    },
    /// A picture with another number of values, or of variances, than the first has values.
    #[error(
        "picture {index}: expected {expected} values and variances, found {found} and {variances}"
    )]
    Size {
        /// Which picture, from 0.
        index: usize,
        /// Values of the first picture.
        expected: usize,
        /// Values of this one.
        found: usize,
        /// Variances of this one.
        variances: usize,
    },
    /// More regions than the matrix has columns.
    #[error(
        "expected at most {expected} regions, one for each column of the matrix, found {found}"
    )]
    Regions {
        /// Columns of the matrix.
        expected: usize,
        /// Regions asked for.
        found: usize,
    },
}

/// Pictures of single regions.
#[derive(Clone, Debug, PartialEq)]
pub struct Demultiplexed {
    /// `[region][pixel]`, in the unit of the pictures.
    pub values: Vec<Vec<f64>>,
    /// `[pixel]`, the square of that unit: the same for every region, since each is made of all
    /// pictures in equal shares. Infinite where any picture is masked.
    pub variance: Vec<f64>,
}

impl SMatrix {
    /// The smallest that has a column for each of `regions` (at least one) regions.
    pub fn for_regions(regions: usize) -> Self {
        let kind = |order: usize| match order {
            n if (n + 1).is_power_of_two() => Some(Kind::Sylvester),
            n if n % 4 == 3 && is_prime(n) => {
                let mut squares = vec![false; n];
                (0..=n / 2).for_each(|x| squares[x * x % n] = true);
                Some(Kind::Paley { squares })
            }
            _ => None,
        };
        // Orders of both kinds go on for ever.
        let found = (regions.max(1)..).find_map(|order| Some(Self { order, kind: kind(order)? }));
        found.unwrap_or(Self { order: 1, kind: Kind::Sylvester })
    }

    /// Rows and columns, n.
    pub fn order(&self) -> usize {
        self.order
    }

    /// Whether picture `row` lights region `column`; false beyond the matrix.
    pub fn lights(&self, row: usize, column: usize) -> bool {
        let n = self.order;
        if row >= n || column >= n {
            return false;
        }
        match &self.kind {
            Kind::Sylvester => ((row + 1) & (column + 1)).count_ones() % 2 == 1,
            Kind::Paley { squares } => squares[(column + n - row) % n],
        }
    }

    /// Pictures of each of `regions` regions alone, x = S⁻¹ y, from one picture for every row,
    /// all of one size and with black subtracted: `pictures[row]`, with their variances.
    ///
    /// For looking at single regions; a fit that takes any pattern does better with the pictures
    /// themselves, each with its own variance.
    ///
    /// # Errors
    /// Another number of pictures than rows, pictures of several sizes, more regions than columns.
    pub fn demultiplex(
        &self,
        pictures: &[Vec<f64>],
        variances: &[Vec<f64>],
        regions: usize,
    ) -> Result<Demultiplexed, DemultiplexError> {
        let n = self.order;
        if pictures.len() != n || variances.len() != n {
            let found = if pictures.len() == n { variances.len() } else { pictures.len() };
            return Err(DemultiplexError::Pictures { expected: n, found });
        }
        if regions > n {
            return Err(DemultiplexError::Regions { expected: n, found: regions });
        }
        let expected = pictures.first().map_or(0, Vec::len);
        for (index, (picture, variance)) in pictures.iter().zip(variances).enumerate() {
            if picture.len() != expected || variance.len() != expected {
                let (found, variances) = (picture.len(), variance.len());
                return Err(DemultiplexError::Size { index, expected, found, variances });
            }
        }
        let scale = 2.0 / (n + 1) as f64;
        let mut variance = vec![0.0; expected];
        for picture in variances {
            variance.iter_mut().zip(picture).for_each(|(sum, v)| *sum += scale * scale * v);
        }
        let value = |region: usize| {
            let mut sum = vec![0.0; expected];
            for (row, picture) in pictures.iter().enumerate() {
                // The element of 2 Sᵀ − J.
                let weight = if self.lights(row, region) { scale } else { -scale };
                sum.iter_mut().zip(picture).for_each(|(sum, y)| *sum += weight * y);
            }
            sum
        };
        Ok(Demultiplexed { values: (0..regions).map(value).collect(), variance })
    }
}

fn is_prime(n: usize) -> bool {
    n >= 2 && (2..).take_while(|d| d * d <= n).all(|d| !n.is_multiple_of(d))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn the_smallest_order_that_has_room_is_taken() {
        let orders = [
            (0, 1),
            (1, 1),
            (2, 3),
            (4, 7),
            (8, 11),
            (12, 15),
            (16, 19),
            (20, 23),
            (36, 43),
            (64, 67),
        ];
        for (regions, order) in orders {
            assert_eq!(SMatrix::for_regions(regions).order(), order, "{regions} regions");
        }
    }

    /// In whole numbers, so without a tolerance: 4 S Sᵀ = (n + 1) (I + J), and as many ones a row.
    #[test]
    fn every_two_rows_share_a_quarter_of_their_ones() {
        for n in [1, 3, 7, 11, 15, 19, 23, 31, 43, 63, 67, 127, 131] {
            let s = SMatrix::for_regions(n);
            assert_eq!(s.order(), n);
            for a in 0..n {
                for b in 0..n {
                    let shared = (0..n).filter(|&j| s.lights(a, j) && s.lights(b, j)).count();
                    let expected = if a == b { 2 * (n + 1) } else { n + 1 };
                    assert_eq!(4 * shared, expected, "order {n}, rows {a} and {b}");
                }
            }
        }
    }

    /// Pictures of the regions lit by each row.
    fn lit(s: &SMatrix, regions: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let pixels = regions[0].len();
        let picture = |row: usize| {
            let mut sum = vec![0.0; pixels];
            for (_, region) in regions.iter().enumerate().filter(|(j, _)| s.lights(row, *j)) {
                sum.iter_mut().zip(region).for_each(|(sum, x)| *sum += x);
            }
            sum
        };
        (0..s.order()).map(picture).collect()
    }

    #[test]
    fn regions_come_back_exactly_where_nothing_is_noisy() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        for count in [1, 3, 9, 16, 25] {
            let s = SMatrix::for_regions(count);
            let mut region = || (0..40).map(|_| rng.random_range(0.0..1.0)).collect();
            let regions: Vec<Vec<f64>> = (0..count).map(|_| region()).collect();
            let pictures = lit(&s, &regions);
            let variances = vec![vec![1.0; 40]; s.order()];
            let found = s.demultiplex(&pictures, &variances, count).unwrap();
            for (a, b) in found.values.iter().flatten().zip(regions.iter().flatten()) {
                // Rounding of sums of at most 31 numbers below 13.
                assert!((a - b).abs() < 1e-13, "{a} {b}");
            }
        }
    }

    /// 2000 pixels × 16 regions tell a variance to 0.8 % (1 sigma; the regions of a pixel are
    /// slightly dependent); 4 % is five.
    #[test]
    fn the_variance_is_the_one_predicted() {
        let mut rng = ChaCha8Rng::seed_from_u64(6);
        let s = SMatrix::for_regions(16);
        // Uniform noise of another width in each picture.
        let width = |row: usize| 0.5 + row as f64 / 10.0;
        let pixels = 2000;
        let noisy = |row: usize, rng: &mut ChaCha8Rng| -> Vec<f64> {
            let w = width(row);
            (0..pixels).map(|_| rng.random_range(-w..w)).collect()
        };
        let pictures: Vec<_> = (0..19).map(|row| noisy(row, &mut rng)).collect();
        let variances: Vec<_> = (0..19).map(|row| vec![width(row).powi(2) / 3.0; pixels]).collect();
        let found = s.demultiplex(&pictures, &variances, 16).unwrap();
        let squares: f64 = found.values.iter().flatten().map(|v| v * v).sum();
        let measured = squares / (16 * pixels) as f64;
        assert!(
            (measured / found.variance[0] - 1.0).abs() < 0.04,
            "{measured} {:?}",
            found.variance[0]
        );
        // Of equal pictures: 4 n/(n + 1)².
        let equal = s.demultiplex(&pictures, &vec![vec![1.0; pixels]; 19], 16).unwrap();
        assert!((equal.variance[7] - 4.0 * 19.0 / 400.0).abs() < 1e-12);
        let mut masked = variances;
        masked[3][11] = f64::INFINITY;
        let found = s.demultiplex(&pictures, &masked, 16).unwrap();
        assert!(found.variance[11].is_infinite() && found.variance[12].is_finite());
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let s = SMatrix::for_regions(3);
        let three = vec![vec![0.0; 4]; 3];
        let short = vec![vec![0.0; 4], vec![0.0; 4], vec![0.0; 3]];
        let size = |index, found, variances| DemultiplexError::Size {
            index,
            expected: 4,
            found,
            variances,
        };
        assert_eq!(s.demultiplex(&three, &short, 3), Err(size(2, 4, 3)));
        assert_eq!(s.demultiplex(&short, &three, 3), Err(size(2, 3, 4)));
        let pictures = DemultiplexError::Pictures { expected: 3, found: 2 };
        assert_eq!(s.demultiplex(&three[..2], &three, 3), Err(pictures.clone()));
        assert_eq!(s.demultiplex(&three, &three[..2], 3), Err(pictures));
        let regions = DemultiplexError::Regions { expected: 3, found: 4 };
        assert_eq!(s.demultiplex(&three, &three, 4), Err(regions));
        assert!(!s.lights(3, 0) && !s.lights(0, 3));
    }
}
