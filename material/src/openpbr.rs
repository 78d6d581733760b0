//! OpenPBR as MaterialX (`.mtlx`): one homogeneous material, for artists' tools.

use std::io::Write;
use std::path::Path;

use crate::average::Average;
use crate::header::About;
use crate::template::in_comment;
use crate::{FileError, Overwrite, ScatteringMedium, atomic_write};

/// Writes an `open_pbr_surface` whose subsurface is the average medium: colour is the albedo of
/// multiple scattering, radius the mean free path in the scene's unit.
///
/// # Errors
/// Another number of channels than 1 or 3, the file is there already and `overwrite` refuses, or
/// the system does.
pub fn write(
    path: &Path,
    medium: &ScatteringMedium<'_>,
    overwrite: Overwrite,
) -> Result<(), FileError> {
    medium.one_or_three(path, "OpenPBR")?;
    let average = Average::colours(medium);
    let path_lengths = average.map(|a| 1.0 / a.sigma_t());
    let longest = path_lengths.into_iter().fold(0.0, f64::max);
    let list = |values: [f64; 3]| values.map(|v| v.to_string()).join(", ");
    let inputs = [
        ("subsurface_weight", "float", "1".into()),
        ("subsurface_color", "color3", list(average.map(|a| a.multiple_albedo()))),
        ("subsurface_radius", "float", longest.to_string()),
        ("subsurface_radius_scale", "color3", list(path_lengths.map(|l| l / longest))),
        ("subsurface_scatter_anisotropy", "float", "0".into()),
        ("specular_ior", "float", medium.material().optics().eta.to_string()),
        ("specular_roughness", "float", "0".into()),
    ];
    atomic_write(path, overwrite, |file| {
        writeln!(file, "<?xml version=\"1.0\"?>")?;
        writeln!(file, "<!-- {} -->", in_comment(&About::of(medium).json()?))?;
        writeln!(file, "<materialx version=\"1.39\" colorspace=\"lin_rec709\">")?;
        writeln!(file, "  <open_pbr_surface name=\"average\" type=\"surfaceshader\">")?;
        for (name, kind, value) in inputs {
            writeln!(file, "    <input name=\"{name}\" type=\"{kind}\" value=\"{value}\" />")?;
        }
        writeln!(file, "  </open_pbr_surface>")?;
        writeln!(file, "  <surfacematerial name=\"block\" type=\"material\">")?;
        let shader = "<input name=\"surfaceshader\" type=\"surfaceshader\" nodename=\"average\" />";
        writeln!(file, "    {shader}")?;
        writeln!(file, "  </surfacematerial>")?;
        writeln!(file, "</materialx>")
    })
}
