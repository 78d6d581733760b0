//! The commands, one file each.

pub(crate) mod branch;
pub(crate) mod calibrate;
pub(crate) mod capture;
pub(crate) mod convert;
pub(crate) mod demo;
pub(crate) mod doctor;
pub(crate) mod export;
pub(crate) mod forward;
pub(crate) mod import;
pub(crate) mod info;
pub(crate) mod init;
pub(crate) mod merge;
mod merge_images;
pub(crate) mod plan;
pub(crate) mod preview;
pub(crate) mod report;
pub(crate) mod rig;
pub(crate) mod solve;
pub(crate) mod status;
pub(crate) mod study;
pub(crate) mod verify;
mod verify_strict;
