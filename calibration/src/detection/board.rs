//! What a board is: a plain chessboard, or one with markers in its light squares (ChArUco).

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::detection::dictionary::MarkerDictionary;
use crate::error::{CalibrationError, Result};

/// A chessboard by its inner corners, with ArUco markers in its light squares or without.
///
/// The corner with index i lies in column i mod `columns` of row i div `columns`. Board frame:
/// origin at corner 0, x along the rows, y down the columns, z away from the viewer, mm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Board {
    /// Inner corners along a row.
    pub columns: usize,
    /// Inner corners along a column.
    pub rows: usize,
    /// Edge of a square, mm.
    pub square_mm: f64,
    /// What stands in the light squares of a ChArUco board; None for a plain chessboard.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub markers: Option<Markers>,
}

/// The markers of a ChArUco board: row by row over its light squares, numbered from 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Markers {
    /// The set that they are from.
    pub dictionary: MarkerDictionary,
    /// Edge of a marker with its dark border, mm.
    pub edge_mm: f64,
}

impl Board {
    /// A plain chessboard.
    pub const fn chessboard(columns: usize, rows: usize, square_mm: f64) -> Self {
        Self { columns, rows, square_mm, markers: None }
    }

    /// A board from words and the edge of a square in mm.
    ///
    /// `9x6` is a plain chessboard of 9 x 6 *inner corners*, as OpenCV counts it.
    /// `charuco:11x8:4x4_50:18` is a ChArUco board of 11 x 8 *squares* (what is printed on such
    /// boards) with markers of the set 4x4_50 whose edge is 18 mm.
    ///
    /// # Errors
    /// [`CalibrationError::BadInput`] names the part that cannot be read: sides that are not
    /// whole numbers from 3 to 200 corners, lengths that are not positive, markers that are larger
    /// than a square or more than the set has.
    pub fn parse(text: &str, square_mm: f64) -> Result<Self> {
        let lower = text.trim().to_ascii_lowercase();
        let board = match lower.strip_prefix("charuco:") {
            Some(rest) => Self::parse_charuco(rest, text, square_mm)?,
            None => {
                let sides = sides(&lower).filter(|s| s.iter().all(|n| (3..=200).contains(n)));
                let [columns, rows] = sides.ok_or_else(|| {
                    bad(
                        "board",
                        "inner corners as COLUMNSxROWS, each from 3 to 200, for instance 9x6; or \
                         charuco:SQUARESxSQUARES:DICTIONARY:MARKER_MM",
                        text,
                    )
                })?;
                Self::chessboard(columns, rows, square_mm)
            }
        };
        board.check()?;
        Ok(board)
    }

    fn parse_charuco(rest: &str, text: &str, square_mm: f64) -> Result<Self> {
        let form = "charuco:SQUARESxSQUARES:DICTIONARY:MARKER_MM with 3 to 200 squares a side, \
                    for instance charuco:11x8:4x4_50:18";
        let parts: Vec<&str> = rest.split(':').collect();
        let &[squares, dictionary, edge] = &parts[..] else {
            return Err(bad("ChArUco board", form, text));
        };
        let dictionary: MarkerDictionary = dictionary.parse()?;
        let sides = sides(squares).filter(|s| s.iter().all(|n| (3..=200).contains(n)));
        let edge = edge.trim().trim_end_matches("mm").trim_end().parse::<f64>().ok();
        match (sides, edge) {
            (Some([across, down]), Some(edge_mm)) => Ok(Self {
                columns: across - 1,
                rows: down - 1,
                square_mm,
                markers: Some(Markers { dictionary, edge_mm }),
            }),
            _ => Err(bad("ChArUco board", form, text)),
        }
    }

    /// Whether this board can exist; for one that was read from a file.
    ///
    /// # Errors
    /// [`CalibrationError::BadInput`] says what cannot be.
    pub fn check(&self) -> Result<()> {
        let least = if self.markers.is_some() { 2 } else { 3 };
        if ![self.columns, self.rows].iter().all(|n| (least..=200).contains(n)) {
            let expected = format!("from {least} to 200 inner corners along each side");
            return Err(bad("board", &expected, &format!("{}x{}", self.columns, self.rows)));
        }
        if !(self.square_mm.is_finite() && self.square_mm > 0.0) {
            let expected = "a positive number of millimetres";
            return Err(bad("square size", expected, &self.square_mm.to_string()));
        }
        let Some(markers) = self.markers else { return Ok(()) };
        if !(markers.edge_mm > 0.0 && markers.edge_mm < self.square_mm) {
            let expected = format!("more than 0 and less than the square's {} mm", self.square_mm);
            return Err(bad("marker size", &expected, &markers.edge_mm.to_string()));
        }
        let needed = ((self.columns + 1) * (self.rows + 1)).div_ceil(2);
        if needed > markers.dictionary.markers() {
            let expected = format!("a set of at least {needed} markers for this board");
            return Err(bad("marker dictionary", &expected, &markers.dictionary.to_string()));
        }
        Ok(())
    }

    /// The inner corners in the board's frame (z = 0), mm, row by row.
    pub fn object_points(&self) -> Vec<[f64; 3]> {
        (0..self.corners()).map(|i| self.object_point(i)).collect()
    }

    /// One inner corner in the board's frame, mm.
    pub fn object_point(&self, index: usize) -> [f64; 3] {
        let (c, r) = (index % self.columns.max(1), index / self.columns.max(1));
        [c as f64 * self.square_mm, r as f64 * self.square_mm, 0.0]
    }

    /// Number of inner corners.
    pub fn corners(&self) -> usize {
        self.columns * self.rows
    }

    /// Whether the board looks different after a half turn: markers, or colours that swap.
    pub(crate) fn has_one_orientation(&self) -> bool {
        self.markers.is_some() || (self.columns + self.rows) % 2 == 1
    }

    /// Free width between a corner and the nearest marker, in squares; a plain board has half a
    /// square to its next edge.
    pub(crate) fn free_squares(&self) -> f64 {
        self.markers.map_or(0.5, |m| (1.0 - m.edge_mm / self.square_mm) / 2.0)
    }
}

/// The board without its measures, for messages: what [`Board::parse`] reads.
impl fmt::Display for Board {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.markers {
            None => write!(f, "{}x{} chessboard", self.columns, self.rows),
            Some(m) => write!(
                f,
                "charuco:{}x{}:{}:{} board",
                self.columns + 1,
                self.rows + 1,
                m.dictionary,
                m.edge_mm
            ),
        }
    }
}

fn sides(text: &str) -> Option<[usize; 2]> {
    let (a, b) = text.split_once(['x', '×'])?;
    Some([a.trim().parse().ok()?, b.trim().parse().ok()?])
}

fn bad(what: &str, expected: &str, found: &str) -> CalibrationError {
    CalibrationError::BadInput { what: what.into(), expected: expected.into(), found: found.into() }
}
