//! How the photographs of one bracket are read: as pictures, or as a sensor's raw codes.

use crate::Failure;
use calibration::{Bayer, NoiseModel, Photo, is_raw, read_raw};
use std::path::Path;

/// What the first photograph of a bracket says about all of them.
pub(crate) struct Reading {
    /// The first photograph without its codes.
    pub first: Photo,
    /// What there is to know if the photographs are raw files.
    pub sensor: Option<Sensor>,
}

/// What raw files say about the sensor that took them.
pub(crate) struct Sensor {
    /// Colours of the upper left 2 × 2 pixels.
    pub bayer: Bayer,
    /// Code without light to which all frames are brought, and at which they clip; a middling
    /// sensor's noise between them.
    pub noise: NoiseModel,
    white_level: u16,
}

impl Reading {
    /// Looks at the first photograph.
    pub fn of(path: &Path) -> Result<Self, Failure> {
        if !is_raw(path) {
            let first = Photo { data: Vec::new(), ..Photo::load(path)? };
            return Ok(Self { first, sensor: None });
        }
        let raw = read_raw(path)?;
        let sensor = Sensor { bayer: raw.bayer, noise: raw.noise(), white_level: raw.white_level };
        Ok(Self { first: Photo { data: Vec::new(), ..raw.photo }, sensor: Some(sensor) })
    }

    /// The pattern of colour sites: that of raw files, which `told` must not contradict.
    pub fn bayer(&self, told: Option<Bayer>) -> Result<Option<Bayer>, Failure> {
        let Some(sensor) = &self.sensor else { return Ok(told) };
        match told {
            Some(told) if told != sensor.bayer => Err(Failure::input(format!(
                "--bayer: expected {:?} as {} has it, found {told:?}",
                sensor.bayer, self.first.name
            ))
            .hint("leave --bayer out: raw files carry their pattern")),
            _ => Ok(Some(sensor.bayer)),
        }
    }

    /// The noise to merge with: the measured one, which says nothing of where raw codes end if
    /// it was measured below; else a middling sensor's.
    pub fn noise(&self, measured: Option<NoiseModel>) -> NoiseModel {
        match (measured, &self.sensor) {
            (Some(noise), Some(sensor)) => {
                NoiseModel { saturation: noise.saturation.min(sensor.noise.saturation), ..noise }
            }
            (Some(noise), None) => noise,
            (None, Some(sensor)) => sensor.noise,
            (None, None) => NoiseModel::for_max_value(self.first.max_value),
        }
    }

    /// Reads a photograph; raw files must be of the same pattern and range as the first, and
    /// their black is brought to where the first one has it.
    pub fn photo(&self, path: &Path) -> Result<Photo, Failure> {
        let Some(sensor) = self.sensor.as_ref().filter(|_| is_raw(path)) else {
            return Ok(Photo::load(path)?);
        };
        let raw = read_raw(path)?;
        if raw.bayer != sensor.bayer || raw.white_level != sensor.white_level {
            return Err(Failure::input(format!(
                "{}: expected the pattern {:?} and white at {} DN as in {}, found {:?} and {} DN",
                raw.photo.name,
                sensor.bayer,
                sensor.white_level,
                self.first.name,
                raw.bayer,
                raw.white_level
            ))
            .hint("take all frames with one camera at one ISO setting"));
        }
        Ok(raw.levelled(sensor.noise.black_level))
    }
}
