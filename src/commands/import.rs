//! `diaphane import`: a session from pictures that another rig or a renderer took.

use crate::Failure;
use crate::average::onto_cells;
use crate::commands::calibrate::{self, subtract};
use crate::manifest::{Light, Manifest, Source};
use crate::measurement::{ARRAYS, CHANNELS, Measured, MeasuredPattern, lit_directly};
use crate::output::{Done, Progress, check_input_folder, counted};
use crate::session::{Config, PlanConfig, RigConfig, Session};
use crate::steps::next_line;
use calibration::{
    FaceMap, FacePlane, HdrImage, NoiseModel, Photo, Response, exif_exposure_s, merge, read_exr,
    recover_response, rectify,
};
use material::{Input, Overwrite};
use rig::Purpose;
use serde_json::json;
use std::collections::BTreeSet;
use std::f64::consts::PI;
use std::path::{Path, PathBuf};

/// Which pictures a session was made from, by their hashes.
pub(crate) const SOURCES: &str = "measurement/import.json";

const EXAMPLE: &str = "Example:\n  diaphane import my-jade --images renders --manifest m.toml\n\nwith m.toml (all keys: docs/import.md):\n  [sample]\n  name = \"jade\"\n  size_mm = [40.0, 40.0, 10.0]\n  cells = [64, 64, 16]\n  lit_face = \"back\"\n  eta = 1.5\n\n  [[pattern]]\n  name = \"region-01\"\n  image = \"region-01.exr\"\n  region = { columns = 4, rows = 4, index = 0 }\n\n  [[pattern]]\n  name = \"left-half\"\n  held_out = true\n  bracket = [{ file = \"a.jpg\" }, { file = \"b.jpg\", exposure_s = 0.5 }]\n  rectangles = [{ x0 = 0.0, y0 = 0.0, x1 = 0.5, y1 = 1.0, level = 1.0 }]";

/// Make a session from pictures that another rig or a renderer took
#[derive(clap::Args)]
#[command(after_help = EXAMPLE)]
pub(crate) struct Args {
    /// Folder of the session to make
    session: PathBuf,
    /// Folder of the pictures that the manifest names
    #[arg(long)]
    images: PathBuf,
    /// What the pictures show (TOML)
    #[arg(long)]
    manifest: PathBuf,
    /// Replace a session that is there
    #[arg(long)]
    force: bool,
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let overwrite = if args.force { Overwrite::Replace } else { Overwrite::Refuse };
    for file in ["session.toml", ARRAYS] {
        let path = args.session.join(file);
        if overwrite == Overwrite::Refuse && path.exists() {
            return Err(material::FileError::Exists { path }.into());
        }
    }
    let manifest = Manifest::load(&args.manifest)?;
    check_input_folder(&args.images, "--images")?;
    let sample = manifest.sample().map_err(|e| named(&args.manifest, e))?;
    let mut reader = Reader::new(&args.images, &manifest);
    // Everything is read before anything is written.
    let measured = reader.measure(&sample)?;
    let mut inputs = vec![Input::from_file(args.manifest.display().to_string(), &args.manifest)?];
    for file in &reader.files {
        inputs.push(Input::from_file(file.as_str(), &args.images.join(file))?);
    }
    let config =
        Config { version: 1, sample, rig: RigConfig::Imported, plan: PlanConfig::default() };
    let session = Session::create(&args.session, config, overwrite)?;
    session.write_json(SOURCES, &inputs, overwrite)?;
    // Its pictures lie elsewhere; their hashes are in a file of their own.
    measured.save(&session, Vec::new(), overwrite)?;
    let folder = session.folder().display();
    let held = measured.select(Purpose::HeldOut).len();
    let text = format!(
        "{folder}: {}, {held} of them held out, on {} × {} cells in {}\n{}",
        counted(measured.patterns.len(), "pattern"),
        measured.cells[0],
        measured.cells[1],
        counted(measured.channels.len(), "channel"),
        next_line(&session)?
    );
    let json = json!({
        "session": session.folder(),
        "output": session.path(ARRAYS),
        "patterns": measured.patterns.len(),
        "held_out": held,
        "channels": measured.channels,
    });
    Ok(Done::new(json, text))
}

fn named(path: &Path, failure: Failure) -> Failure {
    Failure { error: format!("{}: {}", path.display(), failure.error), ..failure }
}

/// Reads pictures as the manifest says.
struct Reader<'a> {
    folder: &'a Path,
    manifest: &'a Manifest,
    /// Recovered from the first bracket.
    response: Option<Response>,
    /// Everything that was read, relative to the folder.
    files: BTreeSet<String>,
}

impl<'a> Reader<'a> {
    fn new(folder: &'a Path, manifest: &'a Manifest) -> Self {
        Self { folder, manifest, response: None, files: BTreeSet::new() }
    }

    fn measure(&mut self, sample: &crate::session::Sample) -> Result<Measured, Failure> {
        let pictures = &self.manifest.pictures;
        let [nx, ny, _] = sample.grid.cells();
        let plane = pictures.calibration.as_deref().map(|f| self.plane(f)).transpose()?;
        let black = pictures.black.as_ref().map(|s| self.picture("black", s)).transpose()?;
        let mut progress = Progress::new("import", self.manifest.patterns.len());
        let mut patterns: Vec<MeasuredPattern> = Vec::new();
        for (done, entry) in self.manifest.patterns.iter().enumerate() {
            progress.set(done, &entry.name);
            let mut image = self.picture(&entry.name, &entry.source().map_err(Failure::input)?)?;
            if let Some(black) = &black {
                self.same_shape(&entry.name, &image, black)?;
                image = subtract(image, black);
            }
            let map = match &plane {
                Some(plane) => {
                    let [hx, hy, _] = sample.grid.spacing_mm();
                    rectify(&image, plane, [nx, ny], [hx, hy])?
                }
                None => rectified(&entry.name, &image, [nx, ny])?,
            };
            let irradiance = match entry.light().map_err(Failure::input)? {
                Light::Pattern(pattern) => pattern
                    .coverage(nx, ny)
                    .map(|c| c.into_iter().map(f64::from).collect())
                    .ok_or_else(|| {
                        Failure::input(format!(
                            "pattern {:?}: does not lie on the face",
                            entry.name
                        ))
                    })?,
                Light::Picture(file) => self.irradiance(&file, [nx, ny])?,
            };
            let (radiance, variance) = self.in_units(&map, image.variance_known);
            if let Some(first) = patterns.first().filter(|p| p.radiance.len() != radiance.len()) {
                return Err(Failure::input(format!(
                    "pattern {:?}: has {}, pattern {:?} has {}",
                    entry.name,
                    counted(radiance.len(), "channel"),
                    first.name,
                    first.radiance.len()
                )));
            }
            let place = (sample.lit_face, [nx, ny]);
            let purpose = match entry.held_out {
                // Of no use for or against a fit: no cell shows multiple scattering alone.
                _ if lit_directly(place.0, place.1, &irradiance).iter().all(|lit| *lit) => {
                    Purpose::Surface
                }
                true => Purpose::HeldOut,
                false => Purpose::Fit,
            };
            let named = (entry.name.clone(), purpose);
            patterns.push(MeasuredPattern::new(named, place, irradiance, radiance, variance));
        }
        progress.finish(&counted(patterns.len(), "pattern"));
        let channels = match patterns.first().map_or(0, |p| p.radiance.len()) {
            3 => CHANNELS.map(str::to_owned).to_vec(),
            _ => vec!["Y".to_owned()],
        };
        Ok(Measured { patterns, cells: [nx, ny], channels })
    }

    /// Radiance and variance of each channel in the unit in which white has 1/π.
    fn in_units(&self, map: &FaceMap, variance_known: bool) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
        let pictures = &self.manifest.pictures;
        let face = map.nx * map.ny;
        let (mut radiance, mut variance) = (Vec::new(), Vec::new());
        for c in 0..map.channels {
            let unit = PI * pictures.white.channel(c);
            let of = |values: &[f32], unit: f64| -> Vec<f64> {
                values[c * face..(c + 1) * face].iter().map(|v| f64::from(*v) / unit).collect()
            };
            let values = of(&map.radiance, unit);
            let known = of(&map.variance, unit * unit);
            // Below a hundredth of the brightest a relative figure would promise too much.
            let floor = 0.01 * values.iter().copied().fold(0.0, f64::max);
            let guessed = |v: f64| (pictures.relative_sigma * v.max(floor)).powi(2);
            variance.push(
                known
                    .iter()
                    .zip(&values)
                    .map(
                        |(var, v)| {
                            if variance_known || !var.is_finite() { *var } else { guessed(*v) }
                        },
                    )
                    .collect(),
            );
            radiance.push(values);
        }
        (radiance, variance)
    }

    fn path(&mut self, file: &str) -> PathBuf {
        self.files.insert(file.to_owned());
        self.folder.join(file)
    }

    fn picture(&mut self, name: &str, source: &Source) -> Result<HdrImage, Failure> {
        let exposures = match source {
            Source::Picture(file) => return Ok(read_exr(self.path(file))?),
            Source::Bracket(exposures) => exposures,
        };
        let mut bracket = Vec::new();
        for exposure in exposures {
            let path = self.path(&exposure.file);
            let seconds = match exposure.exposure_s {
                Some(seconds) => seconds,
                None => exif_exposure_s(&path).map_err(|e| {
                    Failure::input(e)
                        .hint(format!("give exposure_s for {:?} in the manifest", exposure.file))
                })?,
            };
            bracket.push((Photo::load(&path)?, seconds));
        }
        let Some((first, _)) = bracket.first() else {
            return Err(Failure::input(format!("{name}: its bracket is empty")));
        };
        let noise = self
            .manifest
            .pictures
            .noise
            .unwrap_or_else(|| NoiseModel::for_max_value(first.max_value));
        let response = match &self.response {
            Some(response) => response.clone(),
            None if self.manifest.pictures.linear => Response::identity(first.channels),
            None => {
                recover_response(&bracket).map_err(|e| Failure::input(format!("{name}: {e}")))?
            }
        };
        let merged = merge::<Failure>(bracket.into_iter().map(Ok), &response, &noise);
        self.response = Some(response);
        merged.map_err(|e| Failure { error: format!("{name}: {}", e.error), ..e })
    }

    fn same_shape(&self, name: &str, image: &HdrImage, black: &HdrImage) -> Result<(), Failure> {
        let shape = |i: &HdrImage| [i.width, i.height, i.channels];
        if shape(image) == shape(black) {
            return Ok(());
        }
        let [[w, h, c], [bw, bh, bc]] = [shape(image), shape(black)];
        Err(Failure::input(format!(
            "pattern {name:?}: has {w} × {h} pixels in {}, the black picture has {bw} × {bh} in {bc}",
            counted(c, "channel")
        )))
    }

    fn irradiance(&mut self, file: &str, [nx, ny]: [usize; 2]) -> Result<Vec<f64>, Failure> {
        let path = self.path(file);
        let image = read_exr(&path)?;
        let map = rectified(file, &image, [nx, ny])?;
        let bad = map.radiance.iter().zip(&map.variance).find(|(e, v)| **e < 0.0 || !v.is_finite());
        if let Some((found, _)) = bad {
            return Err(Failure::input(format!(
                "{}: expected an irradiance of at least 0 everywhere, found {found} or no number",
                path.display()
            )));
        }
        let face = nx * ny;
        let mean = |i: usize| {
            (0..map.channels).map(|c| f64::from(map.radiance[c * face + i])).sum::<f64>()
        };
        Ok((0..face).map(|i| mean(i) / map.channels as f64).collect())
    }

    /// The front face as the camera saw it: a session's calibration, or a face plane alone.
    fn plane(&mut self, file: &str) -> Result<FacePlane, Failure> {
        let path = self.path(file);
        let told = path.display();
        let bytes = std::fs::read(&path)
            .map_err(|e| Failure::input(format!("{told}: cannot be read: {e}")))?;
        if let Ok(whole) = serde_json::from_slice::<calibrate::Calibrated>(&bytes) {
            return Ok(whole.front);
        }
        serde_json::from_slice(&bytes).map_err(|e| {
            Failure::input(format!(
                "{told}: expected a calibration.json or a face plane (device, pose, z_mm): {e}"
            ))
        })
    }
}

fn rectified(name: &str, image: &HdrImage, [nx, ny]: [usize; 2]) -> Result<FaceMap, Failure> {
    if image.width < nx || image.height < ny {
        return Err(Failure::input(format!(
            "{name}: expected at least one pixel a cell, found {} × {} pixels for {nx} × {ny} cells",
            image.width, image.height
        ))
        .hint("give the sample fewer cells, or larger pictures"));
    }
    Ok(onto_cells(image, [nx, ny]))
}
