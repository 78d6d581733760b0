//! How the simulated sample's light gets from the lit face to the camera.

use crate::monte_carlo::{MonteCarlo, TransportError};
use crate::scene::SceneError;
use diffusion::{CpuSolver, Forward, Illuminations, Medium};
use material::{Face, Optics};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

/// What a simulated sample's pictures are made by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Transport {
    /// The diffusion equation, on a finer grid than the one that is solved.
    #[default]
    Diffusion,
    /// Photons, on the same finer grid: what diffusion only approximates, and noise of its own.
    MonteCarlo {
        /// Photons for each pattern and channel.
        #[serde(default = "default_photons")]
        photons: u64,
        /// Mean cosine of scattering; 0 is isotropic. σs' stays what it is.
        #[serde(default)]
        anisotropy: f64,
    },
}

/// A region's picture is then known to about 1 % in a cell of the built-in samples' grid, in ten
/// seconds or so a pattern on two cores.
fn default_photons() -> u64 {
    2_000_000
}

/// Most photons a pattern: a day or two on two cores.
const MOST_PHOTONS: u64 = 100_000_000_000;

impl Transport {
    /// Monte Carlo as it is unless something else is asked for.
    pub fn monte_carlo() -> Self {
        Self::MonteCarlo { photons: default_photons(), anisotropy: 0.0 }
    }

    /// Checks what came from a file.
    ///
    /// # Errors
    /// Too few photons or too many, a mean cosine outside of (−1, 1).
    pub fn check(&self) -> Result<(), TransportError> {
        let Self::MonteCarlo { photons, anisotropy } = *self else { return Ok(()) };
        if photons > MOST_PHOTONS {
            return Err(TransportError::TooManyPhotons { most: MOST_PHOTONS, found: photons });
        }
        MonteCarlo::check(photons, anisotropy)
    }
}

/// Maps of red, green and blue.
pub(crate) type ExitMaps = Arc<Vec<Vec<f64>>>;

/// Patterns whose maps are kept: a session has fewer.
const KEPT: usize = 256;

/// The sample, lit.
pub(crate) struct LitBlock {
    media: Vec<Medium>,
    optics: Optics,
    lit: Face,
    /// With Monte Carlo: the blocks of the channels, photons, and what was computed already.
    photons: Option<(Vec<MonteCarlo>, u64)>,
    known: Mutex<HashMap<[u8; 32], ExitMaps>>,
}

impl LitBlock {
    pub fn new(
        media: Vec<Medium>,
        optics: Optics,
        lit: Face,
        transport: Transport,
    ) -> Result<Self, SceneError> {
        let photons = match transport {
            Transport::Diffusion => None,
            Transport::MonteCarlo { photons, anisotropy } => {
                let block = |medium| MonteCarlo::new(medium, &optics, anisotropy);
                Some((media.iter().map(block).collect::<Result<_, _>>()?, photons))
            }
        };
        Ok(Self { media, optics, lit, photons, known: Mutex::default() })
    }

    /// True coefficients, one medium a channel.
    pub fn media(&self) -> &[Medium] {
        &self.media
    }

    pub fn optics(&self) -> &Optics {
        &self.optics
    }

    /// Exit radiance of the front face, one map a channel. `seed` stands for sample and pattern:
    /// the same one has the same photons, whenever and wherever it is asked for.
    pub fn exit_radiance(
        &self,
        irradiance: impl FnOnce() -> Vec<[f64; 3]>,
        seed: [u8; 32],
    ) -> Result<ExitMaps, SceneError> {
        let known = || self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if self.photons.is_some()
            && let Some(maps) = known().get(&seed)
        {
            return Ok(Arc::clone(maps));
        }
        let irradiance = irradiance();
        let one = |channel: usize| -> Result<Vec<f64>, SceneError> {
            let medium = &self.media[channel];
            let map = irradiance.iter().map(|e| e[channel]).collect();
            let light = Illuminations::new(medium.grid(), self.lit, vec![map])?;
            if let Some((blocks, photons)) = &self.photons {
                let seed = *blake3::Hasher::new()
                    .update(&seed)
                    .update(&channel.to_le_bytes())
                    .finalize()
                    .as_bytes();
                return Ok(blocks[channel]
                    .radiance(&light, *photons, seed)?
                    .swap_remove(0)
                    .radiance);
            }
            let mut solver = CpuSolver::<f32>::new();
            let mut forward = Forward::new(medium.clone(), &self.optics, &mut solver)?;
            // A tenth of the noise of the best pixel of a bracket.
            Ok(forward.images(&light, 1e-6)?.swap_remove(0))
        };
        let maps = Arc::new((0..self.media.len()).map(one).collect::<Result<Vec<_>, _>>()?);
        if self.photons.is_some() {
            let mut known = known();
            if known.len() >= KEPT {
                known.clear();
            }
            known.insert(seed, Arc::clone(&maps));
        }
        Ok(maps)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Imperfections, SampleKind, SampleSpec, SimulatedRig};
    use rig::Pattern;

    fn photograph(transport: Transport, exposures_s: &[f64]) -> Vec<Vec<u16>> {
        let sample = SampleSpec { kind: SampleKind::Marble, seed: 5 };
        let plain = Imperfections::default();
        let rig = SimulatedRig::with(&sample, Face::Back, &plain, transport).unwrap();
        let mut rig = rig.rig();
        let info = rig.projector.info();
        let white = Pattern::Grey { level: 1.0 }.render(info.width, info.height, None).unwrap();
        rig.projector.show(&white).unwrap();
        exposures_s.iter().map(|t| rig.camera.expose(*t).unwrap().data).collect()
    }

    /// A capture that is taken up again has the frames it would have had: another rig, another
    /// order of exposures, the same bytes.
    #[test]
    fn photons_are_the_same_in_another_run() {
        let few = Transport::MonteCarlo { photons: 6_400, anisotropy: 0.0 };
        let whole = photograph(few, &[0.1, 0.4]);
        assert_eq!(photograph(few, &[0.4])[0], whole[1]);
        let more = Transport::MonteCarlo { photons: 6_464, anisotropy: 0.0 };
        assert_ne!(photograph(more, &[0.4])[0], whole[1]);
    }

    /// Both ways of light through marble of seven mean free paths give pictures of the same
    /// brightness: within 4 %, 2 % of it noise, 1 % diffusion's error, both through the same response.
    #[test]
    fn both_transports_photograph_the_same_block() {
        let photons = Transport::MonteCarlo { photons: 200_000, anisotropy: 0.0 };
        let [a, b] = [Transport::Diffusion, photons].map(|transport| {
            let codes = photograph(transport, &[0.1]).remove(0);
            codes.iter().map(|c| f64::from(*c)).sum::<f64>()
        });
        assert!((a / b - 1.0).abs() < 0.04, "{a} {b}");
    }

    /// The bracket of a pattern is simulated once.
    #[test]
    fn a_known_pattern_is_not_simulated_again() {
        let sample = SampleSpec { kind: SampleKind::Wax, seed: 1 };
        let grid = sample.solved_grid();
        let media = vec![sample.medium(&grid, 0).unwrap()];
        let transport = Transport::MonteCarlo { photons: 640, anisotropy: 0.0 };
        let optics = Optics::from_eta(1.4);
        let block = LitBlock::new(media, optics, Face::Back, transport).unwrap();
        let light = || vec![[1.0; 3]; grid.face_len()];
        let first = block.exit_radiance(light, [1; 32]).unwrap();
        let again = block.exit_radiance(|| panic!("looked at again"), [1; 32]).unwrap();
        assert_eq!(first, again);
        assert_ne!(first, block.exit_radiance(light, [2; 32]).unwrap());
    }

    #[test]
    fn impossible_photons_are_refused() {
        let ask = |photons, anisotropy| Transport::MonteCarlo { photons, anisotropy }.check();
        assert!(ask(2_000_000, 0.5).is_ok());
        assert!(matches!(ask(1, 0.0), Err(TransportError::TooFewPhotons { found: 1 })));
        assert!(matches!(ask(u64::MAX, 0.0), Err(TransportError::TooManyPhotons { .. })));
        assert!(matches!(ask(1000, f64::NAN), Err(TransportError::Anisotropy { .. })));
    }
}
