//! Mitsuba 3: grid volumes (`.vol`), and a scene that renders them.
//!
//! Mitsuba's frame is the renderers' of [`ScatteringMedium`]: z points at the camera.

mod import;
mod surface;
mod volume;

use std::io::Write;
use std::path::{Path, PathBuf};

pub use import::read;
pub use volume::GridVolume;

use crate::header::About;
use crate::template::{filled, in_comment, picture_size};
use crate::{Face, FileError, Overwrite, ScatteringMedium, atomic_write};

/// Beside the volumes: the material without its voxels, as JSON.
const ABOUT: &str = "about.json";
type Quantity = fn((f64, f64)) -> f64;
const VOLUMES: [(&str, Quantity); 4] = [
    ("sigma_t.vol", |(a, s)| a + s),
    ("albedo.vol", |(a, s)| s / (a + s)),
    ("sigma_a.vol", |(a, _)| a),
    ("sigma_s.vol", |(_, s)| s),
];

/// Writes the material as a scene, `path`, and beside it in the same folder:
///
/// - `sigma_t.vol` and `albedo.vol`, which Mitsuba's heterogeneous medium takes, and `sigma_a.vol`
///   and `sigma_s.vol` (σs') for others; coefficients per scene unit;
/// - `render.py`, which renders the scene channel by channel;
/// - `about.json`: units, the optical convention and the material's provenance;
/// - `surface_reflectance.exr`, where the material has a surface: a picture for scenes of one's own.
///   This scene does without, since no BSDF adds light to what a medium sends back through it.
///
/// The scene is the block, lit over all of its lit face and seen from the front; Mitsuba renders it
/// as it is. Returns all files, the scene first.
///
/// # Errors
/// Another number of channels than 1 or 3; one of the files is there already and `overwrite`
/// refuses; the system does. Nothing is written in the first two cases.
pub fn export(
    path: &Path,
    medium: &ScatteringMedium<'_>,
    overwrite: Overwrite,
) -> Result<Vec<PathBuf>, FileError> {
    let channels = medium.one_or_three(path, "Mitsuba")?;
    let beside = |name: &str| path.with_file_name(name);
    let [script, about_it] = ["render.py", ABOUT].map(beside);
    let mut files = vec![path.to_owned(), script.clone(), about_it.clone()];
    files.extend(VOLUMES.iter().map(|(name, _)| beside(name)));
    let picture = medium.material().surface().map(|surface| (beside(surface::PICTURE), surface));
    files.extend(picture.iter().map(|(path, _)| path.clone()));
    if overwrite == Overwrite::Refuse
        && let Some(path) = files.iter().find(|file| file.symlink_metadata().is_ok())
    {
        return Err(FileError::Exists { path: path.clone() });
    }
    for (name, quantity) in VOLUMES {
        let value = |c, i| quantity(medium.sigma(c, i)) as f32;
        GridVolume::of(medium, channels, value).write(&beside(name), overwrite)?;
    }
    if let Some((path, reflectance)) = &picture {
        surface::write(path, medium.material().grid(), reflectance, overwrite)?;
    }
    let text = |path: &Path, text: &str| {
        atomic_write(path, overwrite, |file| file.write_all(text.as_bytes()))
    };
    let failed = |source| FileError::Io { path: about_it.clone(), action: "write", source };
    let about = About::of(medium).json().map_err(failed)?;
    text(&about_it, &about)?;
    let scene_name = path.file_name().unwrap_or_default().to_string_lossy();
    text(&script, &include_str!("render.py").replace("scene.xml", &scene_name))?;
    text(path, &scene(medium, channels, &about).replace("scene.xml", &scene_name))?;
    Ok(files)
}

fn scene(medium: &ScatteringMedium<'_>, channels: usize, about: &str) -> String {
    let [x, y, z] = medium.size();
    let largest = x.max(y).max(z);
    // Further from the face than the distance at which Mitsuba's rays start, 9e-5 (1 + |p|).
    let gap = 1e-3 * (1.0 + largest);
    let (lit, light_z, turn) = match medium.material().lit_face() {
        Face::Back => ("back", -gap, ""),
        Face::Front => ("front", z + gap, "\n            <rotate y=\"1\" angle=\"180\"/>"),
    };
    let eta = medium.material().optics().eta;
    let surface = if eta > 1.0 {
        format!(
            "<bsdf type=\"dielectric\"><float name=\"int_ior\" value=\"{eta}\"/>\
             <float name=\"ext_ior\" value=\"1\"/></bsdf>"
        )
    } else {
        "<bsdf type=\"null\"/>".into()
    };
    let [width, height] = picture_size(x, y);
    filled(
        include_str!("scene.xml"),
        &[
            ("LIT", lit.into()),
            ("ABOUT", in_comment(about)),
            ("NEAR", (1e-3 * largest).to_string()),
            ("FAR", (10.0 * largest).to_string()),
            ("EYE", (z + 2.0 * largest).to_string()),
            ("HALF_X", (x / 2.0).to_string()),
            ("HALF_Y", (y / 2.0).to_string()),
            ("HALF_Z", (z / 2.0).to_string()),
            ("SIZE_X", x.to_string()),
            ("SIZE_Y", y.to_string()),
            ("SIZE_Z", z.to_string()),
            ("WIDTH", width),
            ("HEIGHT", height),
            ("TURN", turn.into()),
            ("LIGHT_Z", light_z.to_string()),
            ("SURFACE", surface),
            ("SPECTRAL", (channels > 1).to_string()),
        ],
    )
}
