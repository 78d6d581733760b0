//! OpenEXR: radiance in R, G, B (or Y), variance beside it in `variance.R` and so on.

use std::path::Path;

use exr::meta::attribute::LineOrder;
use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Encoding, FlatSamples, Image, ReadChannels,
    ReadLayers, SmallVec, Text, Vec2, WritableImage, f16, read,
};
use material::{Overwrite, atomic_write};

use crate::error::{CalibrationError, Result};
use crate::radiometry::hdr::HdrImage;

const CLIPPED: &str = "clippedShortest";
const LOST: &str = "lostLongest";

/// Channel names of grey and colour pictures in our order.
fn names(channels: usize) -> &'static [&'static str] {
    if channels == 1 { &["Y"] } else { &["R", "G", "B"] }
}

/// How many bits the radiance is written in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExrPrecision {
    /// 32 bits, without loss.
    Float,
    /// 16 bits: three digits, up to 65504 and down to 6e-8. The variance keeps 32 bits: its range
    /// is the square of that.
    Half,
}

/// Writes a picture as 32-bit float EXR without loss.
///
/// # Errors
/// As [`write_exr_as`].
pub fn write_exr(path: impl AsRef<Path>, image: &HdrImage, overwrite: Overwrite) -> Result<()> {
    write_exr_as(path, image, ExrPrecision::Float, overwrite)
}

/// Writes a picture as EXR: radiance in R, G, B (or Y), variance in `variance.R` and so on.
///
/// # Errors
/// The file is there and `overwrite` refuses, the system refuses, the picture's arrays do not
/// have its size, or 16 bits do not hold its radiance.
pub fn write_exr_as(
    path: impl AsRef<Path>,
    image: &HdrImage,
    precision: ExrPrecision,
    overwrite: Overwrite,
) -> Result<()> {
    let path = path.as_ref();
    let samples = image.width * image.height * image.channels;
    let whole = image.radiance.len() == samples && image.variance.len() == samples;
    if !whole || !matches!(image.channels, 1 | 3) || samples == 0 {
        return Err(CalibrationError::Mismatch {
            picture: path.display().to_string(),
            expected: format!("{samples} samples of radiance and variance in 1 or 3 channels"),
            found: format!("{} and {}", image.radiance.len(), image.variance.len()),
        });
    }
    let largest = image.radiance.iter().copied().fold(0.0_f32, |a, v| a.max(v.abs()));
    if precision == ExrPrecision::Half && largest > f16::MAX.to_f32() {
        return Err(CalibrationError::Mismatch {
            picture: path.display().to_string(),
            expected: format!("radiance up to {} for 16 bits", f16::MAX),
            found: largest.to_string(),
        });
    }
    let plane = |data: &[f32], c: usize| {
        FlatSamples::F32(data.iter().skip(c).step_by(image.channels).copied().collect())
    };
    let mut channels = SmallVec::new();
    for (c, &name) in names(image.channels).iter().enumerate() {
        let radiance = match precision {
            ExrPrecision::Float => plane(&image.radiance, c),
            ExrPrecision::Half => FlatSamples::F16(
                image
                    .radiance
                    .iter()
                    .skip(c)
                    .step_by(image.channels)
                    .map(|v| f16::from_f32(*v))
                    .collect(),
            ),
        };
        channels.push(AnyChannel::new(name, radiance));
        if image.variance_known {
            let name = Text::from(format!("variance.{name}").as_str());
            channels.push(AnyChannel::new(name, plane(&image.variance, c)));
        }
    }
    let mut file = Image::from_encoded_channels(
        (image.width, image.height),
        // Blocks in the file's order, not in that in which threads get done with them.
        Encoding { line_order: LineOrder::Increasing, ..Encoding::SMALL_LOSSLESS },
        AnyChannels::sort(channels),
    );
    // Each map is written in a random order, so each has one entry: the same picture has to be the
    // same bytes. In the file they stand in one header, the layer's first.
    let count = |n: usize| AttributeValue::I32(i32::try_from(n).unwrap_or(i32::MAX));
    let in_layer = &mut file.layer_data.attributes.other;
    in_layer.insert(Text::from(CLIPPED), count(image.clipped_shortest));
    file.attributes.other.insert(Text::from(LOST), count(image.lost_longest));
    atomic_write(path, overwrite, |out| {
        file.write().to_buffered(out).map_err(|error| std::io::Error::other(error.to_string()))
    })?;
    Ok(())
}

/// Reads an EXR of ours or of other software: R, G, B or one channel, of 16- or 32-bit floats.
///
/// Without variance channels the variance is 1. Samples that are not finite become 0 with
/// infinite variance.
///
/// # Errors
/// Names the file when it is missing, corrupt, or has neither R, G, B nor a single channel.
pub fn read_exr(path: impl AsRef<Path>) -> Result<HdrImage> {
    let path = path.as_ref();
    let bad = |found: String| CalibrationError::BadFile {
        path: path.to_path_buf(),
        expected: "an OpenEXR picture with channels R, G, B or a single one".into(),
        found,
    };
    std::fs::metadata(path).map_err(CalibrationError::io(path))?;
    let file = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .map_err(|error| bad(error.to_string()))?;
    let layer = &file.layer_data;
    let Vec2(width, height) = layer.size;
    let list = &layer.channel_data.list;
    let named =
        |name: &str| list.iter().find(|c| c.name.to_string() == name).map(|c| &c.sample_data);
    let colour: Option<Vec<_>> = names(3).iter().map(|name| named(name)).collect();
    let grey = || {
        let others: Vec<_> =
            list.iter().filter(|c| !c.name.to_string().starts_with("variance.")).collect();
        match others[..] {
            [only] => Some(vec![&only.sample_data]),
            _ => named("Y").map(|y| vec![y]),
        }
    };
    let planes = colour.or_else(grey).ok_or_else(|| {
        bad(format!("channels {:?}", list.iter().map(|c| c.name.to_string()).collect::<Vec<_>>()))
    })?;
    let channels = planes.len();
    let variances: Option<Vec<_>> =
        names(channels).iter().map(|name| named(&format!("variance.{name}"))).collect();
    let pixels = width * height;
    let all = planes.iter().chain(variances.iter().flatten());
    if pixels == 0 || all.clone().any(|plane| plane.len() != pixels) {
        return Err(bad(format!("sub-sampled or empty channels for {width}x{height} pixels")));
    }
    let interleave = |planes: &[&FlatSamples]| {
        let mut data = vec![0.0_f32; pixels * channels];
        for (c, plane) in planes.iter().enumerate() {
            data.iter_mut()
                .skip(c)
                .step_by(channels)
                .zip(plane.values_as_f32())
                .for_each(|(sample, value)| *sample = value);
        }
        data
    };
    let mut radiance = interleave(&planes);
    let mut variance = match &variances {
        Some(planes) => interleave(planes),
        None => vec![1.0; radiance.len()],
    };
    for (value, variance) in radiance.iter_mut().zip(&mut variance) {
        if !value.is_finite() || variance.is_nan() || *variance < 0.0 {
            *variance = f32::INFINITY;
        }
        if !value.is_finite() {
            *value = 0.0;
        }
    }
    // All that is not standard is handed over as the layer's, wherever it was put.
    let count = |name: &str| match layer.attributes.other.get(&Text::from(name)) {
        Some(AttributeValue::I32(count)) => usize::try_from(*count).unwrap_or(0),
        _ => 0,
    };
    Ok(HdrImage {
        width,
        height,
        channels,
        radiance,
        variance,
        variance_known: variances.is_some(),
        clipped_shortest: count(CLIPPED),
        lost_longest: count(LOST),
    })
}
