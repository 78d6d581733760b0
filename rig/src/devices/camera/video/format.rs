//! Formats by their four characters (V4L2: "Image Formats"), and grey values out of their bytes.

use super::node::Layout;
use crate::devices::camera::{Colour, Packing, PixelError, PixelFormat};

/// A format that is understood.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grey {
    /// Its four characters.
    pub code: [u8; 4],
    /// Bits a value.
    pub bits: u8,
    /// Bytes from one grey value to the next.
    step: usize,
    /// Where in a step the grey value begins.
    first: usize,
}

const fn grey(code: [u8; 4], bits: u8, step: usize, first: usize) -> Grey {
    Grey { code, bits, step, first }
}

/// The better ones first: depth, then what the sensor says without a detour over colour. Of the
/// last ones only the brightness is taken.
const KNOWN: [Grey; 8] = [
    grey(*b"Y16 ", 16, 2, 0),
    grey(*b"Y14 ", 14, 2, 0),
    grey(*b"Y12 ", 12, 2, 0),
    grey(*b"Y10 ", 10, 2, 0),
    grey(*b"GREY", 8, 1, 0),
    grey(*b"YUYV", 8, 2, 0),
    grey(*b"UYVY", 8, 2, 1),
    grey(*b"NV12", 8, 1, 0),
];

/// From here on a value of YUV is white (ITU-R BT.601-7, 2.5.3, "quantized to 8 bits").
const WHITE: u16 = 235;

impl Grey {
    /// The number that a device knows it by.
    pub fn number(self) -> u32 {
        u32::from_le_bytes(self.code)
    }

    fn is_yuv(self) -> bool {
        matches!(&self.code, b"YUYV" | b"UYVY" | b"NV12")
    }

    /// The grey values of a picture, row by row.
    ///
    /// Where YUV keeps to 16…235, what is white or beyond counts as clipped: 255. Nothing else
    /// could tell that the sensor was.
    ///
    /// # Errors
    /// There are too few bytes.
    pub fn decode(self, layout: &Layout, bytes: &[u8]) -> Result<Vec<u16>, PixelError> {
        let (width, height) = (layout.width as usize, layout.height as usize);
        let row = width.saturating_mul(self.step);
        // A stride that is less than a row is none.
        let stride = (layout.stride as usize).max(row);
        // The last row may come without its padding.
        let needed = stride.saturating_mul(height.saturating_sub(1)).saturating_add(row);
        if row == 0 || height == 0 || bytes.len() < needed {
            return Err(PixelError {
                expected: format!("{needed} bytes or more, and a pixel"),
                found: format!("{} bytes for {width} x {height} pixels", bytes.len()),
            });
        }
        let rows = bytes.chunks(stride).take(height).map(|line| &line[..row]);
        if self.step == 2 && self.bits == 8 {
            let luma = rows.flat_map(|line| line.iter().skip(self.first).step_by(2));
            return Ok(luma.map(|&v| self.level(layout, u16::from(v))).collect());
        }
        let whole = PixelFormat { colour: Colour::Mono, bits: self.bits, packing: Packing::Whole };
        let mut values = Vec::with_capacity(width.saturating_mul(height));
        for line in rows {
            values.extend(whole.decode(layout.width, 1, 0, line)?.data);
        }
        values.iter_mut().for_each(|value| *value = self.level(layout, *value));
        Ok(values)
    }

    fn level(self, layout: &Layout, value: u16) -> u16 {
        if self.is_yuv() && !layout.full_range && value >= WHITE { 255 } else { value }
    }
}

/// A format's name: its four characters, without blanks at the end.
pub fn name(code: u32) -> String {
    String::from_utf8_lossy(&code.to_le_bytes()).trim_end().to_owned()
}

/// The best of what a device offers: the named format or else the best that is understood, and of
/// that the named size or else the largest. Of a size nothing is said where the device does not.
///
/// # Errors
/// What was asked for is not among it: what is.
pub fn choose(
    offers: &[(u32, Vec<[u32; 2]>)],
    wanted: Option<&str>,
    size: Option<[u32; 2]>,
) -> Result<(Grey, Option<[u32; 2]>), String> {
    let has = || offers.iter().map(|(code, _)| name(*code)).collect::<Vec<_>>().join(", ");
    let of = |grey: &Grey| offers.iter().find(|(code, _)| *code == grey.number());
    let named = |grey: &&Grey| wanted.is_none_or(|wanted| name(grey.number()) == wanted);
    let understood: Vec<&Grey> =
        KNOWN.iter().filter(named).filter(|grey| of(grey).is_some()).collect();
    if understood.is_empty() {
        let known: Vec<String> = KNOWN.iter().map(|grey| name(grey.number())).collect();
        return Err(match wanted {
            Some(wanted) => format!(
                "no pixel format {wanted:?} that is understood; it has {}; understood are {}",
                has(),
                known.join(", ")
            ),
            None => format!("it has {}; understood are {}", has(), known.join(", ")),
        });
    }
    for grey in &understood {
        let Some((_, sizes)) = of(grey) else { continue };
        match size {
            // What it says of its own accord may be the largest of many: asked, it will tell.
            Some(size) if sizes.len() < 2 || sizes.contains(&size) => {
                return Ok((**grey, Some(size)));
            }
            Some(_) => {}
            None => {
                let pixels = |size: &[u32; 2]| u64::from(size[0]) * u64::from(size[1]);
                return Ok((**grey, sizes.iter().copied().max_by_key(pixels)));
            }
        }
    }
    let mut sizes: Vec<[u32; 2]> = understood
        .iter()
        .filter_map(|grey| of(grey))
        .flat_map(|(_, sizes)| sizes.clone())
        .collect();
    sizes.sort_unstable();
    sizes.dedup();
    let sizes: Vec<String> = sizes.iter().map(|[w, h]| format!("{w} x {h}")).collect();
    let [width, height] = size.unwrap_or_default();
    Err(format!("no pictures of {width} x {height}; it has {}", sizes.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn code(name: &[u8; 4]) -> u32 {
        u32::from_le_bytes(*name)
    }

    fn layout(width: u32, height: u32, stride: u32) -> Layout {
        Layout { code: 0, width, height, stride, progressive: true, full_range: true }
    }

    fn known(name: &[u8; 4]) -> Grey {
        *KNOWN.iter().find(|grey| grey.code == *name).unwrap()
    }

    #[test]
    fn the_deepest_format_and_its_largest_picture_are_chosen() {
        let offers = [
            (code(b"MJPG"), vec![[3840, 2160]]),
            (code(b"YUYV"), vec![[640, 480], [1920, 1080]]),
            (code(b"Y10 "), vec![[640, 480], [1280, 720], [320, 240]]),
        ];
        let (grey, size) = choose(&offers, None, None).unwrap();
        assert_eq!((grey.code, grey.bits, size), (*b"Y10 ", 10, Some([1280, 720])));
        // Depth gives way to a size that only another format has.
        let (grey, size) = choose(&offers, None, Some([1920, 1080])).unwrap();
        assert_eq!((grey.code, size), (*b"YUYV", Some([1920, 1080])));
        assert_eq!(choose(&offers, Some("Y10"), None).unwrap().0.code, *b"Y10 ");
        let refused = choose(&offers, None, Some([800, 600])).unwrap_err();
        assert!(refused.contains("800 x 600") && refused.contains("1280 x 720"), "{refused}");
        let refused = choose(&offers, Some("MJPG"), None).unwrap_err();
        assert!(refused.contains("MJPG, YUYV, Y10"), "{refused}");
        assert!(choose(&[], None, None).is_err());
        assert_eq!(choose(&[(code(b"GREY"), vec![])], None, None).unwrap().1, None);
    }

    #[test]
    fn grey_values_come_out_of_every_format() {
        let yuyv = [10, 128, 20, 128, 0, 30, 128, 40, 128, 0];
        assert_eq!(known(b"YUYV").decode(&layout(2, 2, 5), &yuyv).unwrap(), [10, 20, 30, 40]);
        assert_eq!(known(b"UYVY").decode(&layout(2, 1, 4), &[1, 10, 2, 20]).unwrap(), [10, 20]);
        // Two rows of brightness, then one of colour.
        let nv12 = [1, 2, 3, 4, 128, 129];
        assert_eq!(known(b"NV12").decode(&layout(2, 2, 2), &nv12).unwrap(), [1, 2, 3, 4]);
        let y10 = [0xFF, 0x03, 0x01, 0x00];
        assert_eq!(known(b"Y10 ").decode(&layout(2, 1, 0), &y10).unwrap(), [1023, 1]);
        // The last row has no padding.
        assert_eq!(known(b"GREY").decode(&layout(1, 2, 3), &[5, 0, 0, 6]).unwrap(), [5, 6]);
    }

    #[test]
    fn white_of_narrow_yuv_is_clipped_and_no_other() {
        let narrow = Layout { full_range: false, ..layout(2, 1, 0) };
        let full = layout(2, 1, 0);
        let decode =
            |name, layout: &Layout| known(name).decode(layout, &[234, 235, 235, 0]).unwrap();
        assert_eq!(decode(b"NV12", &narrow), [234, 255]);
        assert_eq!(decode(b"YUYV", &narrow), [234, 255]);
        assert_eq!(decode(b"NV12", &full), [234, 235]);
        assert_eq!(decode(b"GREY", &narrow), [234, 235]);
    }

    #[test]
    fn missing_bytes_are_named_and_no_size_is_too_large() {
        let error = known(b"YUYV").decode(&layout(2, 2, 0), &[0; 7]).unwrap_err();
        assert_eq!(error.found, "7 bytes for 2 x 2 pixels");
        for (width, height, stride) in
            [(0, 1, 0), (1, 0, 0), (u32::MAX, u32::MAX, u32::MAX), (1, 2, u32::MAX)]
        {
            for grey in KNOWN {
                assert!(grey.decode(&layout(width, height, stride), &[0; 9]).is_err());
            }
        }
    }
}
