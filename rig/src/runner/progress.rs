//! What a run tells.

use super::Warning;
use crate::Target;

/// A frame is there, or something is tried again.
#[derive(Clone, Debug, PartialEq)]
pub struct Progress<'a> {
    /// Frames that are there.
    pub done: usize,
    /// Frames of the plan.
    pub total: usize,
    /// Name of the shot.
    pub shot: &'a str,
    /// Exposure of the frame, seconds, where it is about one.
    pub requested_s: Option<f64>,
    /// What happened.
    pub step: Step,
    /// Time that the rest should take, judged by the frames and placements of this run and of those
    /// before in the same session, seconds.
    pub left_s: Option<f64>,
}

/// What happened to a frame.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    /// Something is being put on the bench for the shot; the request of a person, where the bench
    /// has no hands of its own.
    Placing(Target),
    /// It was there already, unchanged.
    Kept,
    /// It was taken, and is on disk.
    Taken,
    /// Not yet: what was wrong, in words; it is tried again.
    Retried(String),
    /// It is there, and doubtful.
    Warned(Warning),
    /// Nothing is taken until there is space on the disk: bytes that are free, and that it needs.
    Waiting {
        /// Bytes that the disk still takes.
        free: u64,
        /// Bytes that the coming frame and what is on its way need.
        needed: u64,
    },
}

/// How a run that did not fail ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outcome {
    /// Frames taken now.
    pub taken: usize,
    /// Frames that were there already, unchanged.
    pub kept: usize,
    /// Frames of the plan that are still missing, because the run was asked to stop.
    pub missing: usize,
}
