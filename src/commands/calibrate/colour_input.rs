//! The pictures that `calibrate colour` takes: finished ones, or brackets of a raw sensor.

use crate::Failure;
use crate::output::Progress;
use crate::output::counted;
use calibration::{
    Bayer, CalibrationError, ExposureTable, HdrImage, KNOTS, MasterDark, NoiseModel, Photo,
    Response, exif_exposure_s, list_pictures, merge_mosaic, quads, read_exr, srgb_to_linear,
};
use std::path::{Path, PathBuf};

/// An exposure that is off by more is named.
const NOTABLE: f64 = 0.05;

#[derive(clap::Args)]
pub(crate) struct Input {
    /// A picture of the chart: EXR, or sRGB as PNG, JPEG or TIFF. Several add up: one for each
    /// filter in front of the light
    #[arg(long, conflicts_with = "frames")]
    image: Vec<PathBuf>,
    /// The codes of a PNG, JPEG or TIFF are linear in the light
    #[arg(long, requires = "image")]
    linear: bool,
    /// A folder with the linear exposures of one bracket. Several add up, as above
    #[arg(long, requires_all = ["exposures", "mosaic"])]
    frames: Vec<PathBuf>,
    /// A folder of dark frames (lens covered) at the brackets' exposure times
    #[arg(long, requires = "frames")]
    darks: Option<PathBuf>,
    /// Exposure times of frames and dark frames: lines of "file-name seconds"
    #[arg(long, requires = "frames")]
    exposures: Option<PathBuf>,
    /// The picture is a mosaic of single colours: rggb, bggr, grbg or gbrg from its upper left
    #[arg(long, value_parser = Bayer::parse)]
    mosaic: Option<Bayer>,
    /// A picture of an evenly lit white in the chart's place, to divide by
    #[arg(long, requires = "image")]
    flat: Option<PathBuf>,
}

impl Input {
    /// The first picture's file, or the first bracket's folder.
    pub fn first(&self) -> Result<&Path, Failure> {
        self.image.iter().chain(&self.frames).next().map(PathBuf::as_path).ok_or_else(|| {
            Failure::input("expected a picture of a ColorChecker Classic, found none").hint(
                "give --image chart.jpg; or brackets of a raw sensor: --frames DIR --exposures \
                 times.txt --mosaic rggb",
            )
        })
    }
}

/// A linear colour picture of the chart.
pub(crate) struct Picture {
    pub image: HdrImage,
    /// Sensor pixels along one of its pixels.
    pub binned: f64,
    /// The first file's or folder's name, for messages.
    pub name: String,
}

pub(crate) fn read(input: &Input) -> Result<Picture, Failure> {
    let first = input.first()?;
    let mut parts = if input.image.is_empty() {
        brackets(input)?
    } else {
        input.image.iter().map(|path| picture(path, input)).collect::<Result<Vec<_>, _>>()?
    };
    let name = first.file_name().unwrap_or(first.as_os_str()).to_string_lossy().into_owned();
    let mut image = parts.remove(0);
    for (other, path) in parts.iter().zip(input.image.iter().chain(&input.frames).skip(1)) {
        same_shape(&image, other, path)?;
        for (sum, v) in image.radiance.iter_mut().zip(&other.radiance) {
            *sum += v;
        }
        for (sum, v) in image.variance.iter_mut().zip(&other.variance) {
            *sum += v;
        }
    }
    if let Some(path) = &input.flat {
        divide(&mut image, &picture(path, input)?, path)?;
    }
    let binned = if input.mosaic.is_some() { 2.0 } else { 1.0 };
    Ok(Picture { image, binned, name })
}

fn same_shape(image: &HdrImage, other: &HdrImage, path: &Path) -> Result<(), Failure> {
    let shape = |i: &HdrImage| (i.width, i.height, i.channels);
    if shape(image) == shape(other) {
        return Ok(());
    }
    Err(CalibrationError::Mismatch {
        picture: path.display().to_string(),
        expected: format!("{}x{} pixels as the first", image.width, image.height),
        found: format!(
            "{}x{} pixels, {}",
            other.width,
            other.height,
            counted(other.channels, "channel")
        ),
    }
    .into())
}

/// One finished picture in linear light.
fn picture(path: &Path, input: &Input) -> Result<HdrImage, Failure> {
    let is_exr = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"));
    let image = if is_exr {
        read_exr(path)?
    } else {
        let photo = Photo::load(path)?;
        let response = if input.linear {
            Response::identity(photo.channels)
        } else {
            let code = |k: usize| k as f64 / (KNOTS - 1) as f64;
            let curve = (0..KNOTS).map(|k| srgb_to_linear(code(k))).collect();
            Response::from_exposures(vec![curve; photo.channels])?
        };
        HdrImage::from_photo(&photo, &response)?
    };
    match input.mosaic {
        Some(bayer) => Ok(quads(bayer, &image)?),
        None => Ok(image),
    }
}

/// The merged brackets, one a folder.
fn brackets(input: &Input) -> Result<Vec<HdrImage>, Failure> {
    let missing = |flag: &str| Failure::input(format!("--frames needs {flag}"));
    let table =
        ExposureTable::load(input.exposures.as_ref().ok_or_else(|| missing("--exposures"))?)?;
    let bayer = input.mosaic.ok_or_else(|| missing("--mosaic"))?;
    let darks = match &input.darks {
        Some(folder) => master_darks(folder, &table)?,
        None => Vec::new(),
    };
    let mut progress = Progress::new("merge", input.frames.len());
    let mut out = Vec::new();
    for (i, folder) in input.frames.iter().enumerate() {
        progress.set(i, &folder.display().to_string());
        let pictures = list_pictures(folder)?;
        let depth =
            pictures.first().map(Photo::load).transpose()?.map_or(u16::MAX, |p| p.max_value);
        let frames = pictures
            .iter()
            .map(|path| Ok::<_, Failure>((Photo::load(path)?, seconds(path, &table)?)));
        // Dark frames carry the black level.
        let noise = NoiseModel::for_max_value(depth);
        let (image, report) = merge_mosaic(frames, darks.clone(), &noise, bayer)?;
        for (name, check) in &report.exposures {
            if (check.gain - 1.0).abs() > NOTABLE {
                eprintln!(
                    "warning: {name}: {:.0} % of the light that {} s should have given; corrected",
                    100.0 * check.gain,
                    check.exposure_s
                );
            }
        }
        out.push(image);
    }
    progress.finish("done");
    Ok(out)
}

fn seconds(path: &Path, table: &ExposureTable) -> Result<f64, Failure> {
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    match table.get(&name) {
        Some(seconds) => Ok(seconds),
        None => exif_exposure_s(path).map_err(|_| {
            Failure::input(format!("{name}: not in the table of exposure times"))
                .hint(format!("add a line \"{name} SECONDS\""))
        }),
    }
}

/// Dark frames averaged by exposure time.
fn master_darks(folder: &Path, table: &ExposureTable) -> Result<Vec<MasterDark>, Failure> {
    let mut groups: Vec<(f64, Vec<PathBuf>)> = Vec::new();
    for path in list_pictures(folder)? {
        let time = seconds(&path, table)?;
        match groups.iter_mut().find(|(t, _)| *t == time) {
            Some((_, group)) => group.push(path),
            None => groups.push((time, vec![path])),
        }
    }
    let average = |(time, paths): (f64, Vec<PathBuf>)| {
        MasterDark::average(time, paths.iter().map(|path| Ok(Photo::load(path)?)))
    };
    groups.into_iter().map(average).collect()
}

/// Divides by a flat field whose channels each have a mean of 1: it takes the light's unevenness
/// off, not its colour.
fn divide(image: &mut HdrImage, flat: &HdrImage, path: &Path) -> Result<(), Failure> {
    same_shape(image, flat, path)?;
    let channels = image.channels.max(1);
    let pixels = (flat.radiance.len() / channels).max(1) as f32;
    let mean = |c: usize| flat.radiance.iter().skip(c).step_by(channels).sum::<f32>() / pixels;
    let means: Vec<f32> = (0..channels).map(mean).collect();
    for (i, (value, variance)) in image.radiance.iter_mut().zip(&mut image.variance).enumerate() {
        let gain = flat.radiance[i] / means[i % channels];
        if gain > 0.0 && flat.variance[i].is_finite() {
            *value /= gain;
            *variance /= gain * gain;
        } else {
            *variance = f32::INFINITY;
        }
    }
    Ok(())
}
