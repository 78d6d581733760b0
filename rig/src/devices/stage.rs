//! Stages and turntables: axes that go to a place and say where they are.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::DeviceError;

/// A length, mm.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Millimetres(pub f64);

/// An angle, degrees: what turntables are graduated in. Everywhere else angles are radians.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Degrees(pub f64);

/// A place on an axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Coordinate {
    /// On a slide.
    Linear(Millimetres),
    /// On a turntable.
    Rotary(Degrees),
}

impl Coordinate {
    /// The number, in the axis's own unit.
    pub fn value(self) -> f64 {
        match self {
            Self::Linear(Millimetres(v)) | Self::Rotary(Degrees(v)) => v,
        }
    }

    /// Another place on the same kind of axis.
    pub fn at(self, value: f64) -> Self {
        match self {
            Self::Linear(_) => Self::Linear(Millimetres(value)),
            Self::Rotary(_) => Self::Rotary(Degrees(value)),
        }
    }
}

impl std::fmt::Display for Coordinate {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Linear(Millimetres(v)) => write!(f, "{v:.3} mm"),
            Self::Rotary(Degrees(v)) => write!(f, "{v:.3}°"),
        }
    }
}

/// Where an axis may go.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Range {
    /// A slide, both ends included.
    Linear(Millimetres, Millimetres),
    /// A turntable, both ends included.
    Rotary(Degrees, Degrees),
}

impl Range {
    /// Its ends.
    pub fn ends(self) -> (Coordinate, Coordinate) {
        match self {
            Self::Linear(a, b) => (Coordinate::Linear(a), Coordinate::Linear(b)),
            Self::Rotary(a, b) => (Coordinate::Rotary(a), Coordinate::Rotary(b)),
        }
    }
}

/// One axis of a stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StageAxis {
    /// What the rig file calls it.
    pub name: String,
    /// Where it may go.
    pub range: Range,
    /// Where it is put when the work is over.
    pub park: Option<Coordinate>,
}

impl StageAxis {
    /// `to` as a number in the axis's unit.
    ///
    /// # Errors
    /// `Unsupported` for a place outside of the range, or on the other kind of axis.
    pub fn admit(&self, device: &str, to: Coordinate) -> Result<f64, DeviceError> {
        let (first, last) = self.range.ends();
        let same = std::mem::discriminant(&first) == std::mem::discriminant(&to);
        if same && (first.value()..=last.value()).contains(&to.value()) {
            return Ok(to.value());
        }
        Err(DeviceError::Unsupported {
            device: device.to_owned(),
            reason: format!("axis {} goes from {first} to {last}, not to {to}", self.name),
        })
    }
}

/// Moves things. Axes are numbered from 0 in the order of [`axes`](Self::axes).
///
/// All requests fail with [`DeviceError`] where the stage does not answer, is gone, or answers
/// what its protocol does not know; with `NotHomed` before its first [`home`](Self::home) where it
/// has switches; with `Fault` after an alarm, which stays until [`unlock`](Self::unlock) or `home`;
/// with `Unsupported` for an axis that there is not. A move is never repeated by itself: a controller that lost its connection may have lost
/// its place.
pub trait Stage: Send {
    /// Maker and model as far as the stage tells, else the driver's name for it.
    fn name(&self) -> String;

    /// Its axes.
    fn axes(&self) -> &[StageAxis];

    /// Where an axis is.
    ///
    /// # Errors
    /// See the trait.
    fn position(&mut self, axis: usize) -> Result<Coordinate, DeviceError>;

    /// Goes to a place and returns once it is there.
    ///
    /// # Errors
    /// See the trait; `Unsupported` for a place outside of the axis's range, `Timeout` past
    /// `limit` (the axis is then stopped), `Fault` if it ends up elsewhere.
    fn move_to(&mut self, axis: usize, to: Coordinate, limit: Duration) -> Result<(), DeviceError>;

    /// Comes to rest as fast as it can without losing its place.
    ///
    /// # Errors
    /// See the trait.
    fn hold(&mut self) -> Result<(), DeviceError>;

    /// Stops at once; its place may be lost.
    ///
    /// # Errors
    /// See the trait.
    fn halt(&mut self) -> Result<(), DeviceError>;

    /// Finds its reference and returns once it has it.
    ///
    /// # Errors
    /// See the trait; `Unsupported` if it has no switches, `Timeout` past `limit`.
    fn home(&mut self, limit: Duration) -> Result<(), DeviceError>;

    /// Forgets an alarm. For somebody who has looked at the stage.
    ///
    /// # Errors
    /// See the trait.
    fn unlock(&mut self) -> Result<(), DeviceError>;

    /// Puts each axis that has a parking place there, `limit` for each.
    ///
    /// # Errors
    /// Those of [`move_to`](Self::move_to).
    fn park(&mut self, limit: Duration) -> Result<(), DeviceError> {
        let places: Vec<_> = self.axes().iter().map(|axis| axis.park).collect();
        for (axis, place) in places.into_iter().enumerate() {
            if let Some(place) = place {
                self.move_to(axis, place, limit)?;
            }
        }
        Ok(())
    }
}
