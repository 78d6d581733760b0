//! Boards in pictures: what a board is, where its corners are seen, how good the picture of it is,
//! and why none was found.

pub(crate) mod board;
mod charuco;
mod chessboard;
mod diagnosis;
pub(crate) mod dictionary;
pub(crate) mod found;
pub(crate) mod missing;
mod neighbours;
pub(crate) mod quality;
mod refine;
mod squares;
pub(crate) mod views;
