//! The rig's traits over a scene.

use crate::scene::{Scene, SceneError};
use crate::targets::square_mm;
use crate::{
    BOARD_COLUMNS, BOARD_ROWS, Imperfections, OpticalSetup, SampleSpec, Sensor, Transport,
};
use diffusion::Medium;
use material::{Face, Optics};
use rig::{
    Bench, Camera, CameraInfo, DeviceError, Frame, Projector, ProjectorImage, ProjectorInfo,
    ReferencePatch, Rig, Target,
};
use std::sync::{Arc, Mutex};

/// How much finer, along each axis, the sample is simulated than it is solved.
const REFINEMENT: usize = 2;

/// A rig that exists in software only.
pub struct SimulatedRig {
    world: Arc<World>,
}

/// What nobody but the simulator knows.
pub struct Truth {
    /// True coefficients of red, green and blue.
    pub media: Vec<Medium>,
    /// True diffuse reflectance of the bare surface of red, green and blue, on the front face of the
    /// media's grid, where it is lit; else empty.
    pub surface: Vec<Vec<f64>>,
    /// How light gets in and out; where it is simulated by diffusion, the convention too.
    pub optics: Optics,
    /// Where camera and projector are, and their lenses.
    pub setup: OpticalSetup,
    /// What the rig gets wrong.
    pub imperfections: Imperfections,
}

struct World {
    scene: Scene,
    sensor: Sensor,
    imperfections: Imperfections,
    seed: u64,
    state: Mutex<State>,
}

/// What stands on the rig and what the projector shows; and the radiance of the last such pair
/// that a picture was taken of.
struct State {
    target: Target,
    image: ProjectorImage,
    rendered: Option<Arc<Vec<f32>>>,
    /// Number of the coming frame in its plan, and which repeat of one photograph it is.
    frame: usize,
    repeat: u32,
}

/// Between the beginnings of two frames of a plan, by the simulated lamp's clock, seconds.
const FRAME_S: f64 = 0.5;

impl SimulatedRig {
    /// Builds the rig around a sample that is lit on `lit` face.
    ///
    /// # Errors
    /// The sample's coefficients make no medium; the built-in samples always do.
    pub fn new(sample: &SampleSpec, lit: Face) -> Result<Self, DeviceError> {
        Self::with(sample, lit, &Imperfections::default(), Transport::default())
    }

    /// As [`SimulatedRig::new`], with another projector, lamp or camera, and with the light's way
    /// through the sample simulated otherwise.
    ///
    /// # Errors
    /// As there, and imperfections that no rig can have; too few photons.
    pub fn with(
        sample: &SampleSpec,
        lit: Face,
        imperfections: &Imperfections,
        transport: Transport,
    ) -> Result<Self, DeviceError> {
        imperfections.check().map_err(unsupported)?;
        transport.check().map_err(unsupported)?;
        let scene =
            Scene::new(sample, lit, imperfections, REFINEMENT, transport).map_err(failed)?;
        let [width, height] = scene.setup.projector.size;
        let image = ProjectorImage { width, height, data: vec![0; (width * height) as usize] };
        let state = State { target: Target::Sample, image, rendered: None, frame: 0, repeat: 0 };
        let world = World {
            scene,
            sensor: Sensor { curve: imperfections.camera_response, ..Sensor::default() },
            imperfections: imperfections.clone(),
            seed: sample.seed,
            state: Mutex::new(state),
        };
        Ok(Self { world: Arc::new(world) })
    }

    /// The devices.
    pub fn rig(&self) -> Rig {
        let device = || Device { world: Arc::clone(&self.world) };
        Rig { camera: Box::new(device()), projector: Box::new(device()), bench: Box::new(device()) }
    }

    /// Radiance of every camera pixel, three interleaved channels, without any noise: what a study
    /// holds measurements against.
    ///
    /// # Errors
    /// The light in the sample cannot be solved.
    pub fn radiance(
        &self,
        target: &Target,
        image: &ProjectorImage,
    ) -> Result<Vec<f32>, DeviceError> {
        self.world.scene.render(target, image).map_err(failed)
    }

    /// The sensor's figures, as its data sheet would give them.
    pub fn sensor(&self) -> Sensor {
        self.world.sensor
    }

    /// Columns and rows of the projector.
    pub fn projector_px(&self) -> [u32; 2] {
        self.world.scene.setup.projector.size
    }

    /// The white tile beside the block.
    pub fn reference_patch(&self) -> ReferencePatch {
        self.world.scene.setup.reference_patch()
    }

    /// The printed chessboard that goes with this rig: inner corners a row and a column, and the
    /// edge of a square in mm.
    pub fn board(&self) -> (usize, usize, f64) {
        (BOARD_COLUMNS, BOARD_ROWS, square_mm(&self.world.scene.setup))
    }

    /// What the sample really is.
    pub fn truth(&self) -> Truth {
        let World { scene, imperfections, .. } = &*self.world;
        Truth {
            media: scene.media().to_vec(),
            surface: scene.surface().to_vec(),
            optics: scene.optics(),
            setup: scene.setup,
            imperfections: imperfections.clone(),
        }
    }
}

/// One handle for all three roles: the light path ties them together.
struct Device {
    world: Arc<World>,
}

fn failed(error: SceneError) -> DeviceError {
    unsupported(error)
}

fn unsupported(error: impl std::fmt::Display) -> DeviceError {
    DeviceError::Unsupported { device: NAME.into(), reason: error.to_string() }
}

const NAME: &str = "simulated rig";

impl Device {
    fn with_state<T>(&self, act: impl FnOnce(&mut State) -> T) -> T {
        // A poisoned lock means that a render panicked; the state itself is always whole.
        let mut state = self.world.state.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        act(&mut state)
    }
}

impl Camera for Device {
    fn info(&self) -> CameraInfo {
        let [width, height] = self.world.scene.setup.camera.size;
        let bit_depth = self.world.sensor.bit_depth;
        CameraInfo { name: "simulated camera".into(), width, height, channels: 3, bit_depth }
    }

    fn announce(&mut self, number: usize, repeat: u32) {
        self.with_state(|state| (state.frame, state.repeat) = (number, repeat));
    }

    fn expose(&mut self, exposure_s: f64) -> Result<Frame, DeviceError> {
        let world = &self.world;
        let (radiance, key, steadiness) = self.with_state(|state| -> Result<_, DeviceError> {
            let radiance = match &state.rendered {
                Some(radiance) => Arc::clone(radiance),
                None => {
                    let fresh = world.scene.render(&state.target, &state.image).map_err(failed)?;
                    let fresh = Arc::new(fresh);
                    state.rendered = Some(Arc::clone(&fresh));
                    fresh
                }
            };
            // Noise depends on what is photographed and how, not on what was photographed before:
            // a capture that is taken up again gets the frames it would have got.
            let mut hash = blake3::Hasher::new();
            hash.update(&world.seed.to_le_bytes());
            hash.update(format!("{:?}", state.target).as_bytes());
            hash.update(&state.image.data);
            hash.update(&exposure_s.to_le_bytes());
            // The first photograph of a kind has the noise it always had.
            if state.repeat > 0 {
                hash.update(&state.repeat.to_le_bytes());
            }
            let key = *hash.finalize().as_bytes();
            // The projector has no part in what the light panel shows.
            let steadiness = match state.target {
                Target::Flat | Target::Dark => [1.0; 3],
                _ => {
                    // The wheel stands elsewhere for each frame, by a number of its own.
                    let chance = *hash.update(b"wheel").finalize().as_bytes();
                    let time_s = FRAME_S * state.frame as f64;
                    world.imperfections.steadiness(time_s, exposure_s, chance)
                }
            };
            Ok((radiance, key, steadiness))
        })?;
        let info = Camera::info(self);
        let row = 3 * info.width as usize;
        Ok(Frame {
            width: info.width,
            height: info.height,
            channels: 3,
            bit_depth: info.bit_depth,
            data: world.sensor.expose(&radiance, row, exposure_s, steadiness, key),
            exposure_s,
        })
    }
}

impl Projector for Device {
    fn info(&self) -> ProjectorInfo {
        let [width, height] = self.world.scene.setup.projector.size;
        ProjectorInfo { name: "simulated projector".into(), width, height }
    }

    fn show(&mut self, image: &ProjectorImage) -> Result<(), DeviceError> {
        let [width, height] = self.world.scene.setup.projector.size;
        let pixels = (width * height) as usize;
        if (image.width, image.height) != (width, height) || image.data.len() != pixels {
            return Err(DeviceError::Unsupported {
                device: NAME.into(),
                reason: format!(
                    "an image of {}x{} on {width}x{height} pixels",
                    image.width, image.height
                ),
            });
        }
        self.with_state(|state| {
            if state.image != *image {
                state.image = image.clone();
                state.rendered = None;
            }
        });
        Ok(())
    }
}

impl Bench for Device {
    fn place(&mut self, target: &Target) -> Result<(), DeviceError> {
        self.with_state(|state| {
            if state.target != *target {
                state.target = *target;
                state.rendered = None;
            }
        });
        Ok(())
    }
}
