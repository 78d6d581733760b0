//! The frame model in the unit of the merge: exposure above black, in linearised full scales.

use crate::radiometry::noise::NoiseModel;
use crate::radiometry::response::Response;

/// a · b + c: in one instruction where the machine has it, which saves a quarter of a merge, and
/// without it in two, since the one is emulated there.
pub(super) trait MultiplyAdd {
    fn add(a: f32, b: f32, c: f32) -> f32;
}

/// In one instruction.
pub(super) struct Fused;

/// In two.
pub(super) struct Apart;

impl MultiplyAdd for Fused {
    #[inline(always)]
    fn add(a: f32, b: f32, c: f32) -> f32 {
        a.mul_add(b, c)
    }
}

impl MultiplyAdd for Apart {
    #[inline(always)]
    fn add(a: f32, b: f32, c: f32) -> f32 {
        a * b + c
    }
}

/// Variance of a sample as a function of its mean exposure above black.
pub(super) trait VarianceOf: Copy + Send + Sync {
    /// Whether `constant` is the same everywhere.
    const EVEN: bool;

    /// Read noise and quantisation.
    fn constant(&self, exposure: f32) -> f32;

    /// [`VarianceOf::constant`] of many exposures, whose places are worked out side by side and
    /// only then looked up.
    #[inline(always)]
    fn constants<const N: usize>(&self, exposures: &[f32; N], constants: &mut [f32; N]) {
        constants.iter_mut().zip(exposures).for_each(|(c, e)| *c = self.constant(*e));
    }

    /// Variance for each unit of exposure, of photons.
    fn shot(&self) -> f32;

    /// The whole variance where `constant` is known already.
    #[inline(always)]
    fn with_photons<F: MultiplyAdd>(&self, constant: f32, exposure: f32) -> f32 {
        let (all, least) = (F::add(self.shot(), exposure, constant), FLOOR * constant);
        // One instruction, other than `max`, which heeds NaN.
        if all > least { all } else { least }
    }

    #[inline(always)]
    fn variance(&self, exposure: f32) -> f32 {
        self.with_photons::<Apart>(self.constant(exposure), exposure)
    }
}

/// The photon term goes on below zero, where noise has pushed a sample, down to this share of the
/// dark variance: a corner at zero would give what fluctuates up another weight than what
/// fluctuates down, and pull the mean.
const FLOOR: f32 = 0.2;

/// A linear sensor: dark + shot · exposure.
#[derive(Clone, Copy)]
pub(super) struct Straight {
    pub dark: f32,
    pub shot: f32,
}

impl VarianceOf for Straight {
    const EVEN: bool = true;

    #[inline(always)]
    fn constant(&self, _: f32) -> f32 {
        self.dark
    }

    #[inline(always)]
    fn shot(&self) -> f32 {
        self.shot
    }
}

/// Places of a [`Curved`] table: 32 an octave, from 2⁻²⁴ to 2⁸ full scales.
const PLACES: usize = 1024;

/// A sensor with a response: what is constant in codes is looked up by exposure.
#[derive(Clone, Copy)]
pub(super) struct Curved<'a> {
    pub dark: &'a [f32; PLACES],
    pub shot: f32,
}

impl VarianceOf for Curved<'_> {
    const EVEN: bool = false;

    #[inline(always)]
    fn constant(&self, exposure: f32) -> f32 {
        self.dark[place(exposure) as usize]
    }

    #[inline(always)]
    fn constants<const N: usize>(&self, exposures: &[f32; N], constants: &mut [f32; N]) {
        let places = exposures.map(place);
        for l in 0..N {
            // The remainder changes nothing, but tells the compiler that the place is there.
            constants[l] = self.dark[places[l] as usize % PLACES];
        }
    }

    #[inline(always)]
    fn shot(&self) -> f32 {
        self.shot
    }
}

/// Exponent and five bits of the mantissa number the places.
#[inline(always)]
fn place(exposure: f32) -> u32 {
    const FIRST: i32 = (127 - 24) * 32;
    const LAST: i32 = PLACES as i32 - 1;
    // The sign bit makes what is below zero a negative number, and so the first place.
    ((exposure.to_bits() as i32 >> 18) - FIRST).clamp(0, LAST) as u32
}

/// Values of a 16-bit code: a table of so many needs no look whether the code is in it.
const CODES: usize = 1 << 16;

/// One channel of the camera, tabulated so that no sample costs a power or a logarithm.
pub(super) struct Channel {
    /// Exposure above black of each code; codes beyond full scale have the one of full scale.
    pub exposure: Box<[f32; CODES]>,
    /// Exposure above black at which codes begin to say nothing but "more".
    pub clipped: f32,
    dark: Box<[f32; PLACES]>,
    shot: f32,
    full: usize,
    straight: bool,
}

impl Channel {
    pub fn new(response: &Response, noise: &NoiseModel, channel: usize) -> Self {
        let full = noise.full_scale;
        let black = response.linearise(noise.black_level / full, channel);
        let above = |code: f64| response.linearise(code / full, channel) - black;
        let last = full.clamp(0.0, f64::from(u16::MAX)) as usize;
        let exposure: Vec<f64> = (0..=last).map(|v| above(v as f64)).collect();
        let dark_variance = |code: f64| {
            let slope = response.slope(code / full, channel) / full;
            slope * slope * noise.dark_variance()
        };
        let mut code = 0;
        let dark = std::array::from_fn(|place| {
            let middle = 2.0_f64.powf((place as f64 + 0.5) / 32.0 - 24.0);
            while code < last && exposure[code] < middle {
                code += 1;
            }
            dark_variance((code as f64).max(noise.black_level)) as f32
        });
        Self {
            exposure: Box::new(std::array::from_fn(|code| exposure[code.min(last)] as f32)),
            // Codes from the saturation on are clipped: half a code below the first of them.
            clipped: above(noise.saturation.ceil() - 0.5) as f32,
            dark: Box::new(dark),
            shot: (noise.gain / full) as f32,
            full: last,
            straight: response.is_identity(),
        }
    }

    /// Whether all channels of such a camera are one and the same.
    pub fn is_straight(&self) -> bool {
        self.straight
    }

    /// Scale and black of a linear camera: exposure = scale · code − black.
    pub fn line(&self) -> Option<(f32, f32)> {
        self.straight.then_some((self.exposure[1] - self.exposure[0], -self.exposure[0]))
    }

    pub fn straight(&self) -> Straight {
        Straight { dark: self.dark[0], shot: self.shot }
    }

    pub fn curved(&self) -> Curved<'_> {
        Curved { dark: &self.dark, shot: self.shot }
    }

    pub fn variance(&self, exposure: f32) -> f32 {
        self.curved().variance(exposure)
    }

    /// Exposure above black of a level between codes, such as the mean of dark frames.
    pub fn exposure_of(&self, level: f32) -> f32 {
        let last = self.full.saturating_sub(1);
        let k = (level.max(0.0) as usize).min(last);
        let (low, high) = (self.exposure[k], self.exposure[k + 1]);
        low + (high - low) * (level - k as f32)
    }
}
