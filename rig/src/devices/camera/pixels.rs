//! From the bytes that a camera sends to digital numbers, by the names and codes of the GenICam
//! Pixel Format Naming Convention (PFNC 2.4, tables 6-1 and 6-2; the packings: section 3 there).

use raw::Bayer;

use super::mosaic::superpixels;

/// How a camera lays out the values of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelFormat {
    /// What a value stands for.
    pub colour: Colour,
    /// Bits a value, 8 to 16.
    pub bits: u8,
    /// How values lie in bytes.
    pub packing: Packing,
}

/// What the values of a picture stand for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colour {
    /// Grey.
    Mono,
    /// One colour a pixel.
    Bayer(Bayer),
    /// Red, green and blue a pixel.
    Rgb,
}

/// How values lie in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Packing {
    /// One byte, or two with the low one first, a value.
    Whole,
    /// Values without gaps, the low bits first: names that end in `p`.
    Lsb,
    /// Two values in three bytes, as GigE Vision has it: names that end in `Packed`.
    Gige,
}

/// A picture of which no sense can be made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PixelError {
    /// What should have come.
    pub expected: String,
    /// What came.
    pub found: String,
}

/// Digital numbers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pixels {
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Values a pixel: 1 or 3.
    pub channels: u8,
    /// Row by row, channels interleaved.
    pub data: Vec<u16>,
}

const ORDERS: [Bayer; 4] = [Bayer::Grbg, Bayer::Rggb, Bayer::Gbrg, Bayer::Bggr];

impl PixelFormat {
    const fn new(colour: Colour, bits: u8, packing: Packing) -> Self {
        Self { colour, bits, packing }
    }

    /// The format of a PFNC code; `None` where pictures of it are not understood.
    pub fn of_code(code: u32) -> Option<Self> {
        use Packing::{Gige, Lsb, Whole};
        let mono = |bits, packing| Some(Self::new(Colour::Mono, bits, packing));
        let bayer = |order: u32, bits, packing| {
            let order = ORDERS.get(order as usize)?;
            Some(Self::new(Colour::Bayer(*order), bits, packing))
        };
        // The later codes are in the order of the alphabet: BG, GB, GR, RG, each with 10 and 12.
        let later = |step: u32, bits| {
            let order = [3, 2, 0, 1].get(step as usize)?;
            bayer(*order, bits, Lsb)
        };
        match code {
            0x0108_0001 => mono(8, Whole),
            0x0110_0003 => mono(10, Whole),
            0x010C_0004 => mono(10, Gige),
            0x010A_0046 => mono(10, Lsb),
            0x0110_0005 => mono(12, Whole),
            0x010C_0006 => mono(12, Gige),
            0x010C_0047 => mono(12, Lsb),
            0x0110_0025 => mono(14, Whole),
            0x0110_0007 => mono(16, Whole),
            0x0108_0008..=0x0108_000B => bayer(code - 0x0108_0008, 8, Whole),
            0x0110_000C..=0x0110_000F => bayer(code - 0x0110_000C, 10, Whole),
            0x0110_0010..=0x0110_0013 => bayer(code - 0x0110_0010, 12, Whole),
            0x010C_0026..=0x010C_0029 => bayer(code - 0x010C_0026, 10, Gige),
            0x010C_002A..=0x010C_002D => bayer(code - 0x010C_002A, 12, Gige),
            0x0110_002E..=0x0110_0031 => bayer(code - 0x0110_002E, 16, Whole),
            0x010A_0052 | 0x010A_0054 | 0x010A_0056 | 0x010A_0058 => {
                later((code - 0x010A_0052) / 2, 10)
            }
            0x010C_0053 | 0x010C_0055 | 0x010C_0057 | 0x010C_0059 => {
                later((code - 0x010C_0053) / 2, 12)
            }
            0x0218_0014 => Some(Self::new(Colour::Rgb, 8, Whole)),
            0x0230_0033 => Some(Self::new(Colour::Rgb, 16, Whole)),
            _ => None,
        }
    }

    /// How good a choice it is, the larger the better: depth before all; then what the sensor
    /// itself sees before what the camera made of it; then what is quick to read.
    pub fn merit(self) -> (u8, u8, u8) {
        let colour = match self.colour {
            Colour::Bayer(_) => 2,
            Colour::Mono => 1,
            Colour::Rgb => 0,
        };
        (self.bits, colour, u8::from(self.packing == Packing::Whole))
    }

    /// Values a pixel of what [`decode`](Self::decode) makes of it.
    pub fn channels(self) -> u8 {
        if self.colour == Colour::Mono { 1 } else { 3 }
    }

    /// Width and height of what `decode` makes of `width` × `height` pixels of the sensor.
    pub fn size(self, width: u32, height: u32) -> [u32; 2] {
        match self.colour {
            Colour::Bayer(_) => [width / 2, height / 2],
            _ => [width, height],
        }
    }

    /// The picture of `width` × `height` pixels in `bytes`, whose rows are followed by `padding`
    /// bytes each. A mosaic becomes a picture of half the width and height, see [`superpixels`].
    ///
    /// # Errors
    /// There are too few bytes, or padding after rows that do not end with a byte.
    pub fn decode(
        self,
        width: u32,
        height: u32,
        padding: usize,
        bytes: &[u8],
    ) -> Result<Pixels, PixelError> {
        let samples = if self.colour == Colour::Rgb { 3 } else { 1 };
        let (columns, rows) = (width as usize, height as usize);
        let row_values = columns.saturating_mul(samples);
        let wrong = |expected: String| PixelError {
            expected,
            found: format!("{} bytes for {width} x {height} pixels", bytes.len()),
        };
        let count = row_values.saturating_mul(rows);
        let mut values;
        if padding == 0 {
            let needed = self.bytes(count);
            let bytes = bytes.get(..needed).filter(|_| count > 0);
            let bytes =
                bytes.ok_or_else(|| wrong(format!("{needed} bytes and a pixel or more")))?;
            values = self.unpack(bytes, count);
        } else {
            let row = self.bytes(row_values);
            let stride = row.saturating_add(padding);
            let needed = stride.saturating_mul(rows);
            if count == 0 || bytes.len() < needed || !self.bits_of(row_values).is_multiple_of(8) {
                return Err(wrong(format!("{rows} rows of {row} and {padding} bytes")));
            }
            values = Vec::with_capacity(count);
            for line in bytes.chunks_exact(stride).take(rows) {
                values.extend(self.unpack(&line[..row], row_values));
            }
        }
        let max = u16::MAX >> 16_u8.saturating_sub(self.bits);
        let [out_width, out_height] = self.size(width, height);
        let data = match self.colour {
            Colour::Bayer(_) if out_width == 0 || out_height == 0 => {
                return Err(wrong("2 x 2 pixels or more of a mosaic".into()));
            }
            Colour::Bayer(order) => superpixels(order, columns, &values, max),
            _ => values,
        };
        Ok(Pixels { width: out_width, height: out_height, channels: self.channels(), data })
    }

    /// Bits that `count` values take.
    fn bits_of(self, count: usize) -> usize {
        let each = match (self.packing, self.bits) {
            (Packing::Whole, 8) => 8,
            (Packing::Whole, _) => 16,
            (Packing::Lsb, bits) => usize::from(bits),
            (Packing::Gige, _) => 12,
        };
        count.saturating_mul(each)
    }

    fn bytes(self, count: usize) -> usize {
        self.bits_of(count).div_ceil(8)
    }

    /// `count` values; `bytes` has as many as they take.
    fn unpack(self, bytes: &[u8], count: usize) -> Vec<u16> {
        match (self.packing, self.bits) {
            (Packing::Whole, 8) => bytes.iter().map(|&b| u16::from(b)).collect(),
            (Packing::Whole, _) => {
                bytes.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect()
            }
            (Packing::Lsb, bits) => {
                let mask = (1u32 << bits) - 1;
                let at = |byte: usize| u32::from(bytes.get(byte).copied().unwrap_or(0));
                (0..count)
                    .map(|i| {
                        let bit = i * usize::from(bits);
                        let (byte, shift) = (bit / 8, bit % 8);
                        let word = at(byte) | at(byte + 1) << 8 | at(byte + 2) << 16;
                        (word >> shift & mask) as u16
                    })
                    .collect()
            }
            (Packing::Gige, bits) => {
                let low = bits - 8;
                let mask = (1u16 << low) - 1;
                let at = |byte: usize| u16::from(bytes.get(byte).copied().unwrap_or(0));
                // The high eight bits of either value, their low bits in the byte between.
                (0..count)
                    .map(|i| {
                        let (three, second) = (i / 2 * 3, i % 2);
                        let high = at(three + 2 * second);
                        high << low | at(three + 1) >> (4 * second) & mask
                    })
                    .collect()
            }
        }
    }
}

impl From<PixelError> for String {
    fn from(error: PixelError) -> Self {
        format!("expected {}, found {}", error.expected, error.found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn format(colour: Colour, bits: u8, packing: Packing) -> PixelFormat {
        PixelFormat { colour, bits, packing }
    }

    #[test]
    fn packed_values_come_out_as_the_convention_says() {
        let two = |format: PixelFormat, bytes: &[u8]| format.decode(2, 1, 0, bytes).unwrap().data;
        let mono = |bits, packing| format(Colour::Mono, bits, packing);
        // 0xABC and 0x123, by hand from the convention's drawings.
        assert_eq!(two(mono(12, Packing::Lsb), &[0xBC, 0x3A, 0x12]), [0xABC, 0x123]);
        assert_eq!(two(mono(12, Packing::Gige), &[0xAB, 0x3C, 0x12]), [0xABC, 0x123]);
        // 0x2AB and 0x155.
        assert_eq!(two(mono(10, Packing::Lsb), &[0xAB, 0x56, 0x05]), [0x2AB, 0x155]);
        assert_eq!(two(mono(10, Packing::Gige), &[0xAA, 0x13, 0x55]), [0x2AB, 0x155]);
        assert_eq!(two(mono(16, Packing::Whole), &[0x34, 0x12, 0xFF, 0xFF]), [0x1234, 0xFFFF]);
        assert_eq!(two(mono(8, Packing::Whole), &[7, 255]), [7, 255]);
    }

    #[test]
    fn padding_is_skipped_and_missing_bytes_are_named() {
        let mono = format(Colour::Mono, 8, Packing::Whole);
        let rows = [1, 2, 0, 3, 4, 0];
        assert_eq!(mono.decode(2, 2, 1, &rows).unwrap().data, [1, 2, 3, 4]);
        assert!(mono.decode(2, 2, 1, &rows[..5]).is_err());
        let error = mono.decode(3, 3, 0, &rows).unwrap_err();
        assert_eq!(error.found, "6 bytes for 3 x 3 pixels");
        assert!(mono.decode(0, 3, 0, &rows).is_err());
        assert!(mono.decode(u32::MAX, u32::MAX, 7, &rows).is_err());
        let packed = format(Colour::Mono, 12, Packing::Lsb);
        assert!(packed.decode(1, 2, 1, &rows).is_err(), "half a byte, then padding");
    }

    #[test]
    fn a_camera_of_colour_gives_its_deepest_mosaic() {
        let codes = [0x0108_0001, 0x0218_0014, 0x010C_0059, 0x0110_0011, 0x0108_0009];
        let formats = codes.into_iter().filter_map(PixelFormat::of_code);
        let best = formats.max_by_key(|f| f.merit()).unwrap();
        assert_eq!(best, format(Colour::Bayer(Bayer::Rggb), 12, Packing::Whole));
        assert_eq!(PixelFormat::of_code(0x0210_001F), None, "YUV");
    }
}
