//! The manifest of an import: what pictures of another rig or a renderer show. See docs/import.md.

use crate::Failure;
use crate::session::Sample;
use calibration::NoiseModel;
use material::{BoundaryConvention, Face, Grid, Illumination, LateralBoundary, Scheme};
use rig::{Pattern, Rect};
use serde::Deserialize;
use std::collections::BTreeSet;
use std::path::Path;

/// The file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Manifest {
    sample: SampleEntry,
    #[serde(default)]
    pub pictures: Pictures,
    /// One table a pattern: `[[pattern]]`.
    #[serde(rename = "pattern")]
    pub patterns: Vec<PatternEntry>,
}

/// `[sample]`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SampleEntry {
    name: String,
    size_mm: [f64; 3],
    cells: [usize; 3],
    lit_face: Face,
    eta: f64,
    boundary_constant: Option<f64>,
    #[serde(default)]
    boundary: BoundaryConvention,
    #[serde(default)]
    lateral: LateralBoundary,
    #[serde(default)]
    illumination: Illumination,
    #[serde(default)]
    scheme: Scheme,
}

/// `[pictures]`: what all pictures have in common.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct Pictures {
    /// Value of a white Lambertian plane under irradiance 1, in the pictures' unit.
    pub white: White,
    /// What is seen without projector light.
    pub black: Option<Source>,
    /// Standard deviation of a cell's value relative to it, where the pictures do not tell theirs.
    pub relative_sigma: f64,
    /// A calibration.json or a face plane, where the pictures are not rectified.
    pub calibration: Option<String>,
    /// Brackets come from a linear sensor; else the response is recovered from the first of them.
    pub linear: bool,
    /// The camera's noise, where brackets are merged and it is known.
    pub noise: Option<NoiseModel>,
}

impl Default for Pictures {
    fn default() -> Self {
        Self {
            white: White::Grey(std::f64::consts::FRAC_1_PI),
            black: None,
            relative_sigma: 0.01,
            calibration: None,
            linear: false,
            noise: None,
        }
    }
}

/// One number for all channels, or one a channel.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(untagged)]
pub(crate) enum White {
    Grey(f64),
    Colour([f64; 3]),
}

impl White {
    pub fn channel(self, c: usize) -> f64 {
        match self {
            Self::Grey(white) => white,
            Self::Colour(white) => white.get(c).copied().unwrap_or(white[0]),
        }
    }
}

/// An HDR picture, or a bracket to merge.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub(crate) enum Source {
    Picture(String),
    Bracket(Vec<Exposure>),
}

/// One picture of a bracket.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Exposure {
    pub file: String,
    /// From EXIF where it is not given.
    pub exposure_s: Option<f64>,
}

/// `[[pattern]]`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PatternEntry {
    pub name: String,
    #[serde(default)]
    pub held_out: bool,
    image: Option<String>,
    bracket: Option<Vec<Exposure>>,
    region: Option<Region>,
    rectangles: Option<Vec<Rect>>,
    irradiance: Option<String>,
}

/// One field of the lit face, cut into columns × rows; counted row by row from 0.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Region {
    columns: usize,
    rows: usize,
    index: usize,
}

/// Where the irradiance of a pattern comes from.
pub(crate) enum Light {
    Pattern(Pattern),
    Picture(String),
}

impl Manifest {
    /// Reads and checks a manifest.
    ///
    /// # Errors
    /// Names the file and the key.
    pub fn load(path: &Path) -> Result<Self, Failure> {
        let told = path.display();
        let text = std::fs::read_to_string(path).map_err(|e| {
            Failure::input(format!("{told}: cannot be read: {e}")).hint(
                "it says what the pictures show; an example stands in: diaphane import --help",
            )
        })?;
        let manifest: Self = toml::from_str(&text).map_err(|e| {
            Failure::input(format!("{told}: {}", e.to_string().trim_end()))
                .hint("an example stands in: diaphane import --help")
        })?;
        manifest
            .check()
            .map_err(|e| Failure::input(format!("{told}: {e}")).hint("all keys: docs/import.md"))?;
        Ok(manifest)
    }

    fn check(&self) -> Result<(), String> {
        let positive = |v: f64| v.is_finite() && v > 0.0;
        if !(0..3).all(|c| positive(self.pictures.white.channel(c))) {
            let white = self.pictures.white;
            return Err(format!("pictures.white: expected positive numbers, found {white:?}"));
        }
        if !positive(self.pictures.relative_sigma) {
            let sigma = self.pictures.relative_sigma;
            return Err(format!(
                "pictures.relative_sigma: expected a positive number, found {sigma}"
            ));
        }
        let mut names = BTreeSet::new();
        for pattern in &self.patterns {
            let name = &pattern.name;
            if !names.insert(name) {
                return Err(format!("pattern {name:?}: its name is there twice"));
            }
            pattern.source()?;
            pattern.light()?;
        }
        if self.patterns.iter().all(|p| p.held_out) {
            return Err("pattern: expected at least one that is not held out, found none".into());
        }
        Ok(())
    }

    /// The sample, as a session knows it.
    pub fn sample(&self) -> Result<Sample, Failure> {
        let s = &self.sample;
        let mut spacing = [0.0; 3];
        for ((h, size), n) in spacing.iter_mut().zip(s.size_mm).zip(s.cells) {
            *h = size / n as f64;
        }
        let grid = Grid::new(s.cells, spacing)
            .map_err(|e| Failure::input(format!("sample.size_mm, sample.cells: {e}")))?;
        let sample = Sample {
            name: s.name.clone(),
            grid,
            lit_face: s.lit_face,
            eta: s.eta,
            boundary_constant: s.boundary_constant,
            boundary: s.boundary,
            lateral: s.lateral,
            illumination: s.illumination,
            scheme: s.scheme,
        };
        sample.optics()?;
        Ok(sample)
    }
}

impl PatternEntry {
    /// Where its picture comes from.
    pub fn source(&self) -> Result<Source, String> {
        match (&self.image, &self.bracket) {
            (Some(image), None) => Ok(Source::Picture(image.clone())),
            (None, Some(bracket)) => Ok(Source::Bracket(bracket.clone())),
            (a, b) => Err(format!(
                "pattern {:?}: expected exactly one of image and bracket, found {}",
                self.name,
                usize::from(a.is_some()) + usize::from(b.is_some())
            )),
        }
    }

    /// What lights the sample.
    pub fn light(&self) -> Result<Light, String> {
        let name = &self.name;
        match (&self.region, &self.rectangles, &self.irradiance) {
            (Some(Region { columns, rows, index }), None, None) => {
                if *index >= columns.saturating_mul(*rows) {
                    return Err(format!(
                        "pattern {name:?}: region.index: expected less than {columns} × {rows}, found {index}"
                    ));
                }
                Ok(Light::Pattern(Pattern::region(*columns, *rows, *index)))
            }
            (None, Some(rectangles), None) => {
                let pattern = Pattern::Face { rectangles: rectangles.clone() };
                pattern.check().map_err(|e| format!("pattern {name:?}: rectangles: {e}"))?;
                Ok(Light::Pattern(pattern))
            }
            (None, None, Some(picture)) => Ok(Light::Picture(picture.clone())),
            (a, b, c) => Err(format!(
                "pattern {name:?}: expected exactly one of region, rectangles and irradiance, found {}",
                usize::from(a.is_some()) + usize::from(b.is_some()) + usize::from(c.is_some())
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Manifest, String> {
        let manifest: Manifest = toml::from_str(text).map_err(|e| e.to_string())?;
        manifest.check().map(|()| manifest)
    }

    const SAMPLE: &str = "[sample]\nname = \"a\"\nsize_mm = [8, 8, 4]\ncells = [8, 8, 4]\nlit_face = \"back\"\neta = 1.3\n";

    #[test]
    fn every_kind_of_light_is_read() {
        let text = format!(
            "{SAMPLE}[[pattern]]\nname = \"r\"\nimage = \"r.exr\"\nregion = {{ columns = 4, rows = 4, index = 5 }}\n\
             [[pattern]]\nname = \"q\"\nheld_out = true\nbracket = [{{ file = \"a.jpg\" }}, {{ file = \"b.jpg\", exposure_s = 0.5 }}]\n\
             rectangles = [{{ x0 = 0.0, y0 = 0.0, x1 = 0.5, y1 = 1.0, level = 0.5 }}]\n\
             [[pattern]]\nname = \"p\"\nimage = \"p.exr\"\nirradiance = \"light.exr\"\n"
        );
        let manifest = read(&text).unwrap();
        assert_eq!(manifest.patterns.len(), 3);
        assert!(matches!(manifest.patterns[1].source(), Ok(Source::Bracket(b)) if b.len() == 2));
        assert!(matches!(manifest.patterns[2].light(), Ok(Light::Picture(_))));
        assert_eq!(manifest.sample().unwrap().grid.spacing_mm(), [1.0; 3]);
    }

    #[test]
    fn what_is_wrong_is_named() {
        let one = |more: &str| format!("{SAMPLE}[[pattern]]\nname = \"r\"\n{more}");
        for (text, told) in [
            (one("image = \"r.exr\""), "exactly one of region, rectangles and irradiance"),
            (
                one("region = { columns = 2, rows = 2, index = 0 }"),
                "exactly one of image and bracket",
            ),
            (
                one("image = \"r\"\nregion = { columns = 2, rows = 2, index = 4 }"),
                "less than 2 × 2",
            ),
            (one("image = \"r\"\nregoin = 1"), "regoin"),
            (one("image = \"r\"\nheld_out = true\nirradiance = \"i\""), "not held out"),
            (
                format!("{SAMPLE}[pictures]\nwhite = -1.0\n[[pattern]]\nname = \"r\"\n"),
                "pictures.white",
            ),
        ] {
            let error = read(&text).unwrap_err();
            assert!(error.contains(told), "{error:?} does not tell {told:?}");
        }
    }
}
