//! `diaphane calibrate`: what the pictures of boards, chart and white sheet say about the rig.

mod all;
mod boards;
mod camera;
mod coded;
mod colour;
mod colour_input;
mod convert;
mod face;
mod frames;
mod guide;
mod light;
mod noise;
mod options;
mod points;
mod projector;
mod response;
mod swatches;

pub(crate) use all::{
    Calibrated, RESULT, derive, described, go_on, is_done, lit_plane, load, solve,
};
pub(crate) use frames::{frame_and_time, merge_shot, subtract};

use crate::Failure;
use crate::output::Done;
use clap::Subcommand;

#[derive(Subcommand)]
pub(crate) enum Args {
    /// Everything that a session needs, from its own pictures
    All(all::Args),
    /// A camera, from any folder of photographs of a board
    Camera(camera::Args),
    /// A camera and a projector, from coded light on a printed board
    Projector(projector::Args),
    /// A geometric calibration for other programs, or from them
    Convert(convert::Args),
    /// The projector's light: response, black, contrast, evenness, colour wheel
    Light(light::Args),
    /// A camera's colours, from a photograph of a ColorChecker Classic
    Colour(colour::Args),
    /// A camera's response, from any bracket of photographs
    Response(response::Args),
    /// A sensor's noise, from flat and dark frames
    Noise(noise::Args),
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    match args {
        Args::All(args) => all::run(args),
        Args::Camera(args) => camera::run(args),
        Args::Projector(args) => projector::run(args),
        Args::Convert(args) => convert::run(args),
        Args::Light(args) => light::run(args),
        Args::Colour(args) => colour::run(args),
        Args::Response(args) => response::run(args),
        Args::Noise(args) => noise::run(args),
    }
}
