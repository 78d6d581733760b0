//! Whether a `session.toml` can be carried out: what is written by hand may be anything, and what
//! cannot work is told before pictures are taken for it.

use super::{Config, PlanConfig, RigConfig, Sample};
use calibration::NoiseModel;
use material::Face;
use rig::{ProjectorMethod, SampleScheme};
use simulator::OpticalSetup;

/// Most cells of a grid: 512³, some 20 GB of work space.
const MOST_CELLS: usize = 1 << 27;
/// Poses of the printed board that a camera's calibration takes at least (Zhang 2000, section 3.1).
const LEAST_POSES: usize = 3;
/// Pixels of the projector along a region, at least: fewer do not show where it ends.
const LEAST_REGION_PX: usize = 4;
/// The response is found from exposures that differ by so much at least.
const UNLIKE: f64 = 1.05;

impl Config {
    /// The first thing that cannot be, by its key.
    pub(super) fn check(&self) -> Result<(), String> {
        if self.version == 0 {
            return Err("version: at least 1, found 0".into());
        }
        self.sample.check()?;
        let (camera, projector) = match &self.rig {
            RigConfig::Simulated { sample, board, noise, imperfections, transport } => {
                imperfections.check().map_err(|e| format!("rig.imperfections.{e}"))?;
                transport.check().map_err(|e| format!("rig.transport: {e}"))?;
                board.check().map_err(|e| format!("rig.{e}"))?;
                check_noise(noise)?;
                let setup = OpticalSetup::new(sample, self.sample.lit_face, imperfections);
                (setup.camera.size, Some(setup.projector.size))
            }
            RigConfig::Devices { board, camera, noise } => {
                board.check().map_err(|e| format!("rig.{e}"))?;
                check_noise(noise)?;
                let good = camera.width > 0
                    && camera.height > 0
                    && matches!(camera.channels, 1 | 3)
                    && (8..=16).contains(&camera.bit_depth);
                if !good {
                    return Err(format!(
                        "rig.camera: at least a pixel, 1 or 3 channels, 8 to 16 bits; found {} x {}, {} and {}",
                        camera.width, camera.height, camera.channels, camera.bit_depth
                    ));
                }
                ([camera.width, camera.height], None)
            }
            // Its plan was carried out elsewhere.
            RigConfig::Imported => return Ok(()),
        };
        self.plan.check(&self.sample)?;
        if let Some([width, height]) = projector.filter(|size| *size != self.plan.projector_px) {
            return Err(format!(
                "plan.projector_px: the simulated projector has {width} x {height}, found {:?}",
                self.plan.projector_px
            ));
        }
        let Some(patch) = self.plan.reference_patch else { return Ok(()) };
        for (key, place, [width, height]) in [
            ("camera_px", patch.camera_px, camera),
            ("projector_px", patch.projector_px, self.plan.projector_px),
        ] {
            if !place.fits(width, height) {
                return Err(format!(
                    "plan.reference_patch.{key}: at least a pixel, within {width} x {height}; found {} to {} and {} to {}",
                    place.x0, place.x1, place.y0, place.y1
                ));
            }
        }
        Ok(())
    }
}

impl Sample {
    pub(super) fn check(&self) -> Result<(), String> {
        if self.grid.len() > MOST_CELLS {
            return Err(format!(
                "sample.grid: at most {MOST_CELLS} cells, found {}",
                self.grid.len()
            ));
        }
        if !(self.eta.is_finite() && self.eta >= 1.0) {
            return Err(format!("sample.eta: at least 1, found {}", self.eta));
        }
        match self.boundary_constant {
            Some(c) if !(c.is_finite() && c > 0.0) => {
                Err(format!("sample.boundary_constant: a positive number, found {c}"))
            }
            _ => Ok(()),
        }
    }
}

impl PlanConfig {
    fn check(&self, sample: &Sample) -> Result<(), String> {
        let cells = sample.grid.cells();
        if self.regions.iter().any(|n| !(1..=64).contains(n)) {
            return Err(format!("plan.regions: from 1 to 64 each, found {:?}", self.regions));
        }
        if self.regions[0] > cells[0] || self.regions[1] > cells[1] {
            return Err(format!(
                "plan.regions: no more than the face's {} x {} cells, found {:?}",
                cells[0], cells[1], self.regions
            ));
        }
        if self.scheme == SampleScheme::Multiplexed && sample.lit_face == Face::Front {
            return Err(
                "plan.scheme: \"multiplexed\" needs a block that is lit from the back: lit \
                        from the front, half of each picture would be lit directly and masked"
                    .into(),
            );
        }
        self.check_exposures()?;
        if !(LEAST_POSES..=1000).contains(&self.board_poses) {
            return Err(format!(
                "plan.board_poses: from {LEAST_POSES} to 1000, found {}",
                self.board_poses
            ));
        }
        if !(5..=256).contains(&self.ramp_levels) {
            return Err(format!("plan.ramp_levels: from 5 to 256, found {}", self.ramp_levels));
        }
        self.check_projector()
    }

    fn check_exposures(&self) -> Result<(), String> {
        let response = &self.response_bracket_s;
        for (key, times) in [
            ("bracket_s", self.bracket_s.as_slice()),
            ("reference_bracket_s", &self.reference_bracket_s),
            ("response_bracket_s", response),
            ("board_exposure_s", &[self.board_exposure_s]),
        ] {
            if times.is_empty() || times.iter().any(|t| !(t.is_finite() && *t > 0.0)) {
                return Err(format!("plan.{key}: positive numbers of seconds, found {times:?}"));
            }
        }
        let longest = response.iter().copied().fold(0.0, f64::max);
        let shortest = response.iter().copied().fold(f64::INFINITY, f64::min);
        if longest < UNLIKE * shortest {
            return Err(format!(
                "plan.response_bracket_s: at least two exposures that differ by 5 %, found {response:?}"
            ));
        }
        Ok(())
    }

    fn check_projector(&self) -> Result<(), String> {
        let [width, height] = self.projector_px;
        if [width, height].iter().any(|n| !(8..=16384).contains(n)) {
            return Err(format!(
                "plan.projector_px: from 8 to 16384 each, found {:?}",
                self.projector_px
            ));
        }
        let [columns, rows] = self.regions.map(|n| n * LEAST_REGION_PX);
        if columns > width as usize || rows > height as usize {
            return Err(format!(
                "plan.projector_px: at least {columns} x {rows} for {} x {} regions, found {:?}",
                self.regions[0], self.regions[1], self.projector_px
            ));
        }
        if let ProjectorMethod::PhaseShift(phase) = self.projector_method
            && (!(4..=1024).contains(&phase.period_px) || !(3..=64).contains(&phase.steps))
        {
            return Err(format!(
                "plan.projector_method: a period of 4 to 1024 pixels and 3 to 64 steps, found {} and {}",
                phase.period_px, phase.steps
            ));
        }
        let shown = &self.projector_board;
        if (shown.columns + shown.rows).is_multiple_of(2) {
            return Err(format!(
                "plan.projector_board: one side must be odd and one even, so that a half turn shows; found {} x {}",
                shown.columns, shown.rows
            ));
        }
        let shows = rig::Pattern::Chessboard(*shown);
        shows.check().map_err(|e| format!("plan.projector_board: {e}"))?;
        let end = |from: u32, corners: usize| {
            (corners as u64 + 1).saturating_mul(shown.square_px.into()).saturating_add(from.into())
        };
        let [right, bottom] = [end(shown.x0, shown.columns), end(shown.y0, shown.rows)];
        let whole = right <= u64::from(width) && bottom <= u64::from(height);
        if !whole && self.projector_method == ProjectorMethod::Chessboard {
            return Err(format!(
                "plan.projector_board: within plan.projector_px, {width} x {height}; found one that ends at {right} x {bottom}"
            ));
        }
        Ok(())
    }
}

fn check_noise(noise: &NoiseModel) -> Result<(), String> {
    let NoiseModel { black_level, read_noise, gain, full_scale, saturation } = *noise;
    let good = black_level >= 0.0
        && black_level < saturation
        && saturation <= full_scale
        && full_scale.is_finite()
        && read_noise.is_finite()
        && read_noise >= 0.0
        && gain.is_finite()
        && gain > 0.0;
    if good {
        return Ok(());
    }
    Err(format!(
        "rig.noise: 0 ≤ black_level < saturation ≤ full_scale, read_noise ≥ 0 and gain > 0; found {black_level}, {saturation}, {full_scale}, {read_noise} and {gain}"
    ))
}
