//! The acquired material itself.

use serde::{Deserialize, Serialize};

use crate::{Face, Grid, Optics, Provenance, Resolution, Surface};

/// κ and μ of every voxel of a block, per colour channel, with everything that is needed
/// to relight it: the grid, the optical convention and the face that was lit.
///
/// Values are positive and finite and every array has `grid.len()` entries in grid order;
/// [`Material::new`] checks that, so holders need not.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    grid: Grid,
    channels: Vec<Channel>,
    optics: Optics,
    lit_face: Face,
    provenance: Provenance,
    resolution: Option<Vec<Resolution>>,
    surface: Option<Vec<Surface>>,
}

/// The coefficients in one colour channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// "R", "G" or "B"; other names for other sensors.
    pub name: String,
    /// Diffusion coefficient κ = 1/(3(μ + σs')) of each voxel, mm.
    pub kappa_mm: Vec<f32>,
    /// Absorption μ of each voxel, 1/mm.
    pub mu_per_mm: Vec<f32>,
    /// Measured over modelled radiance, fitted beside κ and μ: 1 where the radiometry is right.
    pub gain: f64,
}

/// Which of a channel's arrays is meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Coefficient {
    /// Diffusion coefficient, mm.
    Kappa,
    /// Absorption, 1/mm.
    Mu,
    /// Finest detail of κ that the images determine, mm.
    KappaResolution,
    /// The same of μ.
    MuResolution,
    /// Diffuse reflectance of the surface itself, of the cells of the front face.
    SurfaceReflectance,
}

impl Coefficient {
    /// What its values have to be, in words, and whether one is.
    fn requirement(self) -> (&'static str, fn(f32) -> bool) {
        match self {
            Self::Kappa | Self::Mu => ("positive and finite", |v| v.is_finite() && v > 0.0),
            Self::KappaResolution | Self::MuResolution => ("positive", |v| v > 0.0),
            Self::SurfaceReflectance => ("finite and at least 0", |v| v.is_finite() && v >= 0.0),
        }
    }

    /// What has one value of it, and how many of these a grid has.
    pub(crate) fn places(self, grid: &Grid) -> (&'static str, usize) {
        match self {
            Self::SurfaceReflectance => ("cell of the front face", grid.face_len()),
            _ => ("voxel", grid.len()),
        }
    }
}

impl std::fmt::Display for Coefficient {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Coefficient::Kappa => "kappa",
            Coefficient::Mu => "mu",
            Coefficient::KappaResolution => "resolution of kappa",
            Coefficient::MuResolution => "resolution of mu",
            Coefficient::SurfaceReflectance => "surface reflectance",
        })
    }
}

/// Why a set of arrays is not a material.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MaterialError {
    /// No channel.
    #[error("a material needs at least one colour channel, found none")]
    NoChannels,
    /// Two channels of one name.
    #[error("channel names must differ, found {0:?} twice")]
    SameName(String),
    /// An array that does not fit the grid.
    #[error(
        "channel {channel}: {coefficient} needs one value a {place} ({expected}), found {found}"
    )]
    WrongLength {
        /// Channel name.
        channel: String,
        /// The array.
        coefficient: Coefficient,
        /// What has one value.
        place: &'static str,
        /// How many of these the grid has.
        expected: usize,
        /// Length of the array.
        found: usize,
    },
    /// A value that is zero, negative or not a number.
    #[error(
        "channel {channel}: {coefficient} must be {}, found {value} in voxel ({}, {}, {}) (index {index})",
        coefficient.requirement().0, voxel[0], voxel[1], voxel[2]
    )]
    BadValue {
        /// Channel name.
        channel: String,
        /// The array.
        coefficient: Coefficient,
        /// Position in the array.
        index: usize,
        /// The voxel's x, y and z.
        voxel: [usize; 3],
        /// The value found.
        value: f32,
    },
    /// A gain that is zero, negative or not a number.
    #[error("channel {channel}: the gain must be positive and finite, found {value}")]
    BadGain {
        /// Channel name.
        channel: String,
        /// The value found.
        value: f64,
    },
    /// Not one resolution a channel.
    #[error("a material of {expected} channels needs as many resolutions, found {found}")]
    ResolutionCount {
        /// Channels.
        expected: usize,
        /// Resolutions given.
        found: usize,
    },
    /// Not one surface a channel.
    #[error("a material of {expected} channels needs as many surface reflectances, found {found}")]
    SurfaceCount {
        /// Channels.
        expected: usize,
        /// Surfaces given.
        found: usize,
    },
    /// A surface whose light nobody saw.
    #[error(
        "a surface reflectance needs a material lit on the front face, found one lit on the back"
    )]
    SurfaceUnlit,
    /// An impossible refractive index.
    #[error("the refractive index must be at least 1 and finite, found {0}")]
    BadEta(f64),
    /// An impossible boundary constant.
    #[error("the boundary constant C must be positive and finite, found {0}")]
    BadBoundaryConstant(f64),
}

impl Material {
    /// A material from its parts.
    ///
    /// # Errors
    /// No channels, two of one name, an array whose length is not `grid.len()`, a value that
    /// is not positive and finite (the first one is named), or optics that make no sense.
    pub fn new(
        grid: Grid,
        channels: Vec<Channel>,
        optics: Optics,
        lit_face: Face,
        provenance: Provenance,
    ) -> Result<Self, MaterialError> {
        if channels.is_empty() {
            return Err(MaterialError::NoChannels);
        }
        if !(optics.eta.is_finite() && optics.eta >= 1.0) {
            return Err(MaterialError::BadEta(optics.eta));
        }
        if !(optics.boundary_constant.is_finite() && optics.boundary_constant > 0.0) {
            return Err(MaterialError::BadBoundaryConstant(optics.boundary_constant));
        }
        for (i, channel) in channels.iter().enumerate() {
            if channels[..i].iter().any(|other| other.name == channel.name) {
                return Err(MaterialError::SameName(channel.name.clone()));
            }
            if !(channel.gain.is_finite() && channel.gain > 0.0) {
                let value = channel.gain;
                return Err(MaterialError::BadGain { channel: channel.name.clone(), value });
            }
            check(&grid, channel, Coefficient::Kappa, &channel.kappa_mm)?;
            check(&grid, channel, Coefficient::Mu, &channel.mu_per_mm)?;
        }
        let (resolution, surface) = (None, None);
        Ok(Self { grid, channels, optics, lit_face, provenance, resolution, surface })
    }

    /// The same material with how far its images determine it, one for each channel.
    ///
    /// # Errors
    /// Not one for each channel, an array whose length is not `grid.len()`, or a value that is not
    /// positive.
    pub fn with_resolution(self, resolution: Vec<Resolution>) -> Result<Self, MaterialError> {
        let (expected, found) = (self.channels.len(), resolution.len());
        if expected != found {
            return Err(MaterialError::ResolutionCount { expected, found });
        }
        for (channel, resolution) in self.channels.iter().zip(&resolution) {
            check(&self.grid, channel, Coefficient::KappaResolution, &resolution.kappa_mm)?;
            check(&self.grid, channel, Coefficient::MuResolution, &resolution.mu_mm)?;
        }
        Ok(Self { resolution: Some(resolution), ..self })
    }

    /// The same material with what its surface reflects by itself, one for each channel.
    ///
    /// # Errors
    /// A material that is lit on the back face, not one for each channel, an array whose length is
    /// not `grid.face_len()`, or a value that is negative or not finite.
    pub fn with_surface(self, surface: Vec<Surface>) -> Result<Self, MaterialError> {
        if self.lit_face != Face::Front {
            return Err(MaterialError::SurfaceUnlit);
        }
        let (expected, found) = (self.channels.len(), surface.len());
        if expected != found {
            return Err(MaterialError::SurfaceCount { expected, found });
        }
        for (channel, surface) in self.channels.iter().zip(&surface) {
            check(&self.grid, channel, Coefficient::SurfaceReflectance, &surface.reflectance)?;
        }
        Ok(Self { surface: Some(surface), ..self })
    }

    /// The voxel grid.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The channels, in colour order.
    pub fn channels(&self) -> &[Channel] {
        &self.channels
    }

    /// The channel of that name.
    pub fn channel(&self, name: &str) -> Option<&Channel> {
        self.channels.iter().find(|channel| channel.name == name)
    }

    /// How far the images determine each channel; None where nobody has looked.
    pub fn resolution(&self) -> Option<&[Resolution]> {
        self.resolution.as_deref()
    }

    /// What the surface reflects by itself in each channel; None where it is not known, as for every
    /// material that is lit from the back.
    pub fn surface(&self) -> Option<&[Surface]> {
        self.surface.as_deref()
    }

    /// The optical convention that the coefficients hold under.
    pub fn optics(&self) -> &Optics {
        &self.optics
    }

    /// The face that was lit during acquisition.
    pub fn lit_face(&self) -> Face {
        self.lit_face
    }

    /// Where the material came from.
    pub fn provenance(&self) -> &Provenance {
        &self.provenance
    }
}

fn check(
    grid: &Grid,
    channel: &Channel,
    coefficient: Coefficient,
    values: &[f32],
) -> Result<(), MaterialError> {
    let channel = || channel.name.clone();
    let (place, expected) = coefficient.places(grid);
    if values.len() != expected {
        let found = values.len();
        return Err(MaterialError::WrongLength {
            channel: channel(),
            coefficient,
            place,
            expected,
            found,
        });
    }
    let (_, good) = coefficient.requirement();
    match values.iter().position(|&v| !good(v)) {
        None => Ok(()),
        Some(index) => {
            let [nx, ny, _] = grid.cells();
            let voxel = [index % nx, index / nx % ny, index / (nx * ny)];
            let value = values[index];
            Err(MaterialError::BadValue { channel: channel(), coefficient, index, voxel, value })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn build(change: impl FnOnce(&mut Vec<Channel>, &mut Optics)) -> Result<Material, String> {
        let grid = Grid::new([4, 3, 2], [0.5, 0.5, 0.25]).unwrap();
        let channel = |name: &str| Channel {
            name: name.into(),
            kappa_mm: vec![0.3; 24],
            mu_per_mm: vec![0.01; 24],
            gain: 1.0,
        };
        let mut channels = vec![channel("R"), channel("G")];
        let mut optics = Optics::from_eta(1.4);
        change(&mut channels, &mut optics);
        Material::new(grid, channels, optics, Face::Back, Provenance::default())
            .map_err(|e| e.to_string())
    }

    #[test]
    fn bad_parts_are_named() {
        assert!(build(|_, _| ()).is_ok());
        let says = |change: &dyn Fn(&mut Vec<Channel>, &mut Optics), parts: &[&str]| {
            let message = build(|c, o| change(c, o)).unwrap_err();
            for part in parts {
                assert!(message.contains(part), "{message:?} does not say {part:?}");
            }
        };
        says(&|c, _| c[1].kappa_mm[17] = f32::NAN, &["G", "kappa", "NaN", "(1, 1, 1)", "17"]);
        says(&|c, _| c[0].mu_per_mm[0] = -0.5, &["R", "mu", "-0.5", "(0, 0, 0)"]);
        says(&|c, _| c[0].mu_per_mm[4] = f32::INFINITY, &["R", "mu", "inf", "(0, 1, 0)"]);
        says(&|c, _| c[0].mu_per_mm[3] = 0.0, &["mu", "found 0", "(3, 0, 0)"]);
        says(&|c, _| c[0].kappa_mm.truncate(20), &["kappa", "24", "20"]);
        says(&|c, _| c[1].name = "R".into(), &["R", "twice"]);
        says(&|c, _| c[1].gain = f64::INFINITY, &["gain", "inf"]);
        says(&|c, _| c.clear(), &["channel"]);
        says(&|_, o| o.eta = 0.9, &["0.9"]);
        says(&|_, o| o.boundary_constant = f64::NAN, &["C", "NaN"]);
    }

    #[test]
    fn a_bad_surface_is_named() {
        let lit = |face| Material { lit_face: face, ..build(|_, _| ()).unwrap() };
        let fine = Surface { reflectance: vec![0.0; 12] };
        let says = |face, surface: Vec<Surface>, part: &str| {
            let error = lit(face).with_surface(surface).unwrap_err();
            assert!(error.to_string().contains(part), "{error} does not say {part:?}");
        };
        assert!(lit(Face::Front).with_surface(vec![fine.clone(); 2]).is_ok());
        says(Face::Back, vec![fine.clone(); 2], "lit on the front face");
        says(Face::Front, vec![fine.clone()], "2 channels");
        let mut bad = fine.clone();
        bad.reflectance[5] = -0.25;
        let told =
            "G: surface reflectance must be finite and at least 0, found -0.25 in voxel (1, 1, 0)";
        says(Face::Front, vec![fine.clone(), bad], told);
        let volume = Surface { reflectance: vec![0.1; 24] };
        let told = "R: surface reflectance needs one value a cell of the front face (12), found 24";
        says(Face::Front, vec![volume, fine], told);
    }

    #[test]
    fn a_bad_resolution_is_named() {
        let fine = Resolution { kappa_mm: vec![f32::INFINITY; 24], mu_mm: vec![0.5; 24] };
        let says = |resolution: Vec<Resolution>, part: &str| {
            let error = build(|_, _| ()).unwrap().with_resolution(resolution).unwrap_err();
            assert!(error.to_string().contains(part), "{error} does not say {part:?}");
        };
        assert!(build(|_, _| ()).unwrap().with_resolution(vec![fine.clone(); 2]).is_ok());
        says(vec![fine.clone()], "2 channels");
        let mut bad = fine.clone();
        bad.mu_mm[5] = f32::NAN;
        says(vec![fine.clone(), bad], "G: resolution of mu must be positive, found NaN");
        let short = Resolution { kappa_mm: vec![1.0; 3], ..fine.clone() };
        says(vec![short, fine], "R: resolution of kappa needs one value a voxel (24), found 3");
    }
}
