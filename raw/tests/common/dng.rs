//! Writes the least that is a valid DNG: one uncompressed 16-bit mosaic in one strip.

/// What to write.
#[derive(Clone)]
pub struct Dng {
    /// Pixels per row of the whole sensor.
    pub width: u32,
    /// Rows of the whole sensor.
    pub height: u32,
    /// Codes of the whole sensor, row by row.
    pub codes: Vec<u16>,
    /// Sites of the colour filter a row and a column, and their colours: 0 red, 1 green, 2 blue.
    pub filter: (u16, Vec<u8>),
    /// Black of the upper left 2 × 2 light-sensitive pixels.
    pub black: [u16; 4],
    /// White.
    pub white: u32,
    /// Top, left, bottom and right of what sees light.
    pub active: [u32; 4],
    /// Exposure time in seconds as a fraction.
    pub exposure: (u32, u32),
}

/// A field of a directory: tag, type, values as bytes.
type Field = (u16, u16, Vec<u8>);

const BYTE: u16 = 1;
const ASCII: u16 = 2;
const SHORT: u16 = 3;
const LONG: u16 = 4;
const RATIONAL: u16 = 5;
const SRATIONAL: u16 = 10;

fn shorts(values: &[u16]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn longs(values: &[u32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// A directory at `offset`: fields by tag, then what does not fit into four bytes.
fn directory(offset: usize, fields: &[Field]) -> Vec<u8> {
    let mut head = shorts(&[fields.len() as u16]);
    let mut tail: Vec<u8> = Vec::new();
    let after = offset + 2 + 12 * fields.len() + 4;
    for (tag, kind, bytes) in fields {
        let size = match *kind {
            SHORT => 2,
            LONG => 4,
            RATIONAL | SRATIONAL => 8,
            _ => 1,
        };
        head.extend(shorts(&[*tag, *kind]));
        head.extend(longs(&[(bytes.len() / size) as u32]));
        if bytes.len() <= 4 {
            head.extend(bytes);
            head.extend(vec![0; 4 - bytes.len()]);
        } else {
            head.extend(longs(&[(after + tail.len()) as u32]));
            tail.extend(bytes);
            tail.extend(vec![0; tail.len() % 2]);
        }
    }
    head.extend([0; 4]);
    head.extend(tail);
    head
}

impl Dng {
    /// The file.
    pub fn bytes(&self) -> Vec<u8> {
        let strip = shorts(&self.codes);
        let exif_at = 8 + strip.len();
        let (numerator, denominator) = self.exposure;
        let exif = directory(exif_at, &[(33434, RATIONAL, longs(&[numerator, denominator]))]);
        let (sites, colours) = &self.filter;
        let matrix = [1, 0, 0, 0, 1, 0, 0, 0, 1].map(|v| [v, 1]).concat();
        let main_at = exif_at + exif.len();
        let main = directory(
            main_at,
            &[
                (254, LONG, longs(&[0])),                  // NewSubfileType: the picture
                (256, LONG, longs(&[self.width])),         // ImageWidth
                (257, LONG, longs(&[self.height])),        // ImageLength
                (258, SHORT, shorts(&[16])),               // BitsPerSample
                (259, SHORT, shorts(&[1])),                // Compression: none
                (262, SHORT, shorts(&[32803])),            // Photometric: colour filter
                (271, ASCII, b"Diaphane\0".to_vec()),      // Make
                (272, ASCII, b"Made up\0".to_vec()),       // Model
                (273, LONG, longs(&[8])),                  // StripOffsets
                (274, SHORT, shorts(&[1])),                // Orientation
                (277, SHORT, shorts(&[1])),                // SamplesPerPixel
                (278, LONG, longs(&[self.height])),        // RowsPerStrip
                (279, LONG, longs(&[strip.len() as u32])), // StripByteCounts
                (284, SHORT, shorts(&[1])),                // PlanarConfiguration
                (33421, SHORT, shorts(&[*sites, *sites])), // CFARepeatPatternDim
                (33422, BYTE, colours.clone()),            // CFAPattern
                (34665, LONG, longs(&[exif_at as u32])),   // ExifIFD
                (50706, BYTE, vec![1, 4, 0, 0]),           // DNGVersion
                (50707, BYTE, vec![1, 1, 0, 0]),           // DNGBackwardVersion
                (50708, ASCII, b"Diaphane made up\0".to_vec()), // UniqueCameraModel
                (50713, SHORT, shorts(&[2, 2])),           // BlackLevelRepeatDim
                (50714, SHORT, shorts(&self.black)),       // BlackLevel
                (50717, LONG, longs(&[self.white])),       // WhiteLevel
                (50721, SRATIONAL, longs(&matrix)),        // ColorMatrix1
                (50728, RATIONAL, longs(&[1; 6])),         // AsShotNeutral
                (50778, SHORT, shorts(&[21])),             // CalibrationIlluminant1: D65
                (50829, LONG, longs(&self.active)),        // ActiveArea
            ],
        );
        let mut file = b"II*\0".to_vec();
        file.extend(longs(&[main_at as u32]));
        [file, strip, exif, main].concat()
    }
}
