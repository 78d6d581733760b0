//! The two precisions that the Krylov iteration and its preconditioner can run in.

/// `f32` or `f64`.
pub trait Real: bytemuck::Pod + Send + Sync + Default + PartialEq + std::fmt::Debug {
    /// 0.
    const ZERO: Self;
    /// Relative residual below which a recursively updated residual means nothing any more.
    const RESIDUAL_FLOOR: f64;
    /// Rounds from double precision.
    fn from_f64(value: f64) -> Self;
    /// Widens to double precision.
    fn to_f64(self) -> f64;
    /// self · a + b, contracted where the machine can.
    fn mul_add(self, a: Self, b: Self) -> Self;
    /// Product.
    fn mul(self, a: Self) -> Self;
    /// Sum.
    fn add(self, a: Self) -> Self;
    /// Difference.
    fn sub(self, a: Self) -> Self;
    /// The value times −1.
    fn neg(self) -> Self;
}

macro_rules! real {
    ($type:ty, $floor:expr) => {
        impl Real for $type {
            const ZERO: Self = 0.0;
            const RESIDUAL_FLOOR: f64 = $floor;
            #[inline(always)]
            fn from_f64(value: f64) -> Self {
                value as $type
            }
            #[inline(always)]
            fn to_f64(self) -> f64 {
                f64::from(self)
            }
            #[inline(always)]
            fn mul_add(self, a: Self, b: Self) -> Self {
                self.mul_add(a, b)
            }
            #[inline(always)]
            fn mul(self, a: Self) -> Self {
                self * a
            }
            #[inline(always)]
            fn add(self, a: Self) -> Self {
                self + a
            }
            #[inline(always)]
            fn sub(self, a: Self) -> Self {
                self - a
            }
            #[inline(always)]
            fn neg(self) -> Self {
                -self
            }
        }
    };
}
real!(f32, 2e-7);
real!(f64, 1e-14);

/// `L` values of one cell, one for each field of a block.
pub type Lanes<T, const L: usize> = [T; L];

// Plain loops, not `array::from_fn`: these bodies must be inlined into a function that was
// compiled for the machine's vector unit, and nothing forces `from_fn` to be.

#[inline(always)]
pub fn splat<T: Real, const L: usize>(value: T) -> Lanes<T, L> {
    [value; L]
}

/// a · x + y with one scalar for all lanes.
#[inline(always)]
pub fn scale_add<T: Real, const L: usize>(a: T, x: &Lanes<T, L>, y: &Lanes<T, L>) -> Lanes<T, L> {
    let mut out = [T::ZERO; L];
    for l in 0..L {
        out[l] = a.mul_add(x[l], y[l]);
    }
    out
}

/// a · x with one scalar for all lanes.
#[inline(always)]
pub fn scale<T: Real, const L: usize>(a: T, x: &Lanes<T, L>) -> Lanes<T, L> {
    let mut out = [T::ZERO; L];
    for l in 0..L {
        out[l] = a.mul(x[l]);
    }
    out
}

/// x + y.
#[inline(always)]
pub fn sum<T: Real, const L: usize>(x: &Lanes<T, L>, y: &Lanes<T, L>) -> Lanes<T, L> {
    let mut out = [T::ZERO; L];
    for l in 0..L {
        out[l] = x[l].add(y[l]);
    }
    out
}

/// x − y.
#[inline(always)]
pub fn difference<T: Real, const L: usize>(x: &Lanes<T, L>, y: &Lanes<T, L>) -> Lanes<T, L> {
    let mut out = [T::ZERO; L];
    for l in 0..L {
        out[l] = x[l].sub(y[l]);
    }
    out
}

/// a · x + y with one scalar a lane.
#[inline(always)]
pub fn lane_mul_add<T: Real, const L: usize>(
    a: &Lanes<T, L>,
    x: &Lanes<T, L>,
    y: &Lanes<T, L>,
) -> Lanes<T, L> {
    let mut out = [T::ZERO; L];
    for l in 0..L {
        out[l] = a[l].mul_add(x[l], y[l]);
    }
    out
}
