//! `diaphane calibrate`: what the pictures of boards, chart and white sheet say about the rig.

mod all;
mod camera;
mod noise;
mod response;

pub(crate) use all::{Calibrated, RESULT, is_done, lit_plane, load, merge_shot, solve, subtract};

use crate::Failure;
use crate::output::Done;
use clap::Subcommand;

#[derive(Subcommand)]
pub(crate) enum Args {
    /// Everything that a session needs, from its own pictures
    All(all::Args),
    /// A camera, from any folder of photographs of a chessboard
    Camera(camera::Args),
    /// A camera's response, from any bracket of photographs
    Response(response::Args),
    /// A sensor's noise, from flat and dark frames
    Noise(noise::Args),
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    match args {
        Args::All(args) => all::run(args),
        Args::Camera(args) => camera::run(args),
        Args::Response(args) => response::run(args),
        Args::Noise(args) => noise::run(args),
    }
}
