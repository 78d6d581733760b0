//! Why a picture is of no use for a calibration.

use std::fmt;

use crate::detection::found::SeenCorner;

/// The corners found, or why not; [`NoBoard::NotSeen`] calls for a diagnosis.
pub(crate) type Look = Result<Vec<SeenCorner>, NoBoard>;

/// The likeliest reason for not finding a board, or not well enough.
///
/// Shown, it says what was seen; what to do about it is for the caller to add.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum NoBoard {
    /// Even the brightest parts are dark.
    TooDark {
        /// The code that 99 % of the pixels stay below, over full scale.
        bright: f64,
    },
    /// Light and dark squares differ by a few codes only.
    TooFaint {
        /// Light minus dark squares, codes.
        contrast_codes: f64,
    },
    /// Light and dark squares are at full scale alike.
    Clipped {
        /// Share of the pixels, or of the board's light squares, at full scale.
        share: f64,
    },
    /// Edges as wide as the squares, or nothing sharp anywhere.
    Blurred {
        /// Width of the edges from 10 to 90 %, pixels.
        edge_px: f64,
        /// Edge of the smallest square, pixels, where the board could be told.
        square_px: Option<f64>,
    },
    /// Squares of too few pixels.
    TooSmall {
        /// Edge of the smallest square, pixels.
        square_px: f64,
    },
    /// A plain chessboard that the picture's edge cuts off: which of its corners are in view is
    /// not decidable.
    PartlyOutside {
        /// Inner corners in view, along the longer and the shorter side.
        seen: [usize; 2],
    },
    /// Another number of corners.
    OtherBoard {
        /// Inner corners seen, along the longer and the shorter side; None if only that there are
        /// more than there should be.
        seen: Option<[usize; 2]>,
        /// Inner corners of the board that was looked for.
        asked: [usize; 2],
    },
    /// Markers that do not stand where this board has them.
    OtherMarkers {
        /// Markers of the set that were read.
        read: usize,
        /// Those that stand where this board has them.
        fitting: usize,
    },
    /// Some of a ChArUco board's corners are in view, but fewer than a use needs.
    Incomplete {
        /// Corners seen.
        seen: usize,
        /// Corners needed.
        corners: usize,
    },
    /// Too many corners disagree with their neighbours.
    OutOfLine {
        /// How many.
        corners: usize,
    },
    /// Nothing like a board.
    NotSeen,
    /// Anything else, in words.
    Other(String),
}

impl fmt::Display for NoBoard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooDark { bright } => write!(
                f,
                "too dark: 99 % of the pixels are below {:.1} % of full scale",
                100.0 * bright
            ),
            Self::TooFaint { contrast_codes } => {
                write!(f, "too dark: light and dark squares are {contrast_codes:.0} codes apart")
            }
            Self::Clipped { share } => {
                write!(f, "clipped: {:.0} % of the light is at full scale", 100.0 * share)
            }
            Self::Blurred { edge_px, square_px: Some(square_px) } => write!(
                f,
                "blurred: its edges are {edge_px:.1} px wide on squares of {square_px:.1} px"
            ),
            Self::Blurred { edge_px, square_px: None } => {
                write!(f, "blurred: no edge is sharper than {edge_px:.0} px")
            }
            Self::TooSmall { square_px } => {
                write!(f, "too small: its squares are {square_px:.1} px wide")
            }
            Self::PartlyOutside { seen: [long, short] } => write!(
                f,
                "partly outside: {long}x{short} inner corners are in view, and a plain chessboard \
                 does not tell which of its corners they are"
            ),
            Self::OtherBoard { seen: None, .. } => {
                f.write_str("its squares go on beyond that many corners")
            }
            Self::OtherBoard { seen: Some([long, short]), asked } => {
                write!(f, "this looks like a board of {long}x{short} inner corners")?;
                if *long <= asked[0] && *short <= asked[1] {
                    f.write_str(", or the rest of it is not in view")?;
                }
                Ok(())
            }
            Self::OtherMarkers { read, fitting } => write!(
                f,
                "another board: of {read} markers that were read {fitting} stand where this board \
                 has them"
            ),
            Self::Incomplete { seen, corners } => {
                write!(f, "{seen} of its corners are in view, {corners} are needed")
            }
            Self::OutOfLine { corners } => {
                write!(f, "{corners} corners are out of line with their neighbours")
            }
            Self::NotSeen => {
                write!(f, "not seen whole: is every inner corner in view, and is it this board?")
            }
            Self::Other(reason) => f.write_str(reason),
        }
    }
}

impl From<&str> for NoBoard {
    fn from(reason: &str) -> Self {
        Self::Other(reason.to_owned())
    }
}
