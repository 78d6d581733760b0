//! What goes through the pipes between a capture and its window.

use std::io::{self, Read, Write};

use serde::{Deserialize, Serialize};

use crate::ProjectorImage;

/// What the window is told.
#[derive(Debug)]
pub(super) enum Order {
    /// Show this, and answer when it stands.
    Show(ProjectorImage),
    /// Say whether it has stood undisturbed since.
    Confirm,
}

/// What it answers, a line of JSON each.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub(super) enum Reply {
    /// The window is there and black, or the order was carried out.
    Done,
    /// Something covered the picture, or bent its levels; it is as it should be again.
    Disturbed,
    /// It cannot be done, and why.
    Unable(String),
    /// The window or its monitor is gone; nothing more will come.
    Gone,
}

const SHOW: u8 = b's';
const CONFIRM: u8 = b'c';

/// Larger than any projector's picture: 16384 × 16384.
const MOST_PIXELS: u64 = 1 << 28;

impl Order {
    pub(super) fn write(&self, pipe: &mut impl Write) -> io::Result<()> {
        match self {
            Self::Show(image) => {
                pipe.write_all(&[SHOW])?;
                pipe.write_all(&image.width.to_le_bytes())?;
                pipe.write_all(&image.height.to_le_bytes())?;
                pipe.write_all(&image.data)?;
            }
            Self::Confirm => pipe.write_all(&[CONFIRM])?,
        }
        pipe.flush()
    }

    /// The next order; an error at the end of the pipe, too.
    pub(super) fn read(pipe: &mut impl Read) -> io::Result<Self> {
        let mut tag = [0];
        pipe.read_exact(&mut tag)?;
        match tag {
            [SHOW] => {}
            [CONFIRM] => return Ok(Self::Confirm),
            _ => return Err(io::ErrorKind::InvalidData.into()),
        }
        let mut number = || {
            let mut bytes = [0; 4];
            pipe.read_exact(&mut bytes).map(|()| u32::from_le_bytes(bytes))
        };
        let (width, height) = (number()?, number()?);
        let pixels = u64::from(width) * u64::from(height);
        if pixels > MOST_PIXELS {
            return Err(io::ErrorKind::InvalidData.into());
        }
        let mut data = vec![0; usize::try_from(pixels).map_err(|_| io::ErrorKind::InvalidData)?];
        pipe.read_exact(&mut data)?;
        Ok(Self::Show(ProjectorImage { width, height, data }))
    }
}
