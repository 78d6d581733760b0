//! The pipeline from a session's frames to a material, and the command line over it.

mod adaptive;
mod average;
mod checkpoint;
pub mod cli;
mod commands;
mod compute;
mod conversion;
mod devices;
mod exposures;
mod failure;
mod manifest;
mod measurement;
mod output;
mod plot;
mod reading;
mod regime;
mod report;
mod resolution;
mod sensor;
mod session;
mod statistics;
mod steps;
mod study;
mod surface;
mod technician;
mod wheel;

pub use failure::Failure;
