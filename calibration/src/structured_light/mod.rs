//! Which projector pixel lights what the camera sees: Gray code and phase shift.

pub(crate) mod check;
pub(crate) mod classify;
pub(crate) mod corners;
pub(crate) mod decode;
pub(crate) mod homography;
pub(crate) mod layout;
pub(crate) mod pairing;
pub(crate) mod phase;
pub(crate) mod samples;
pub(crate) mod steps;
