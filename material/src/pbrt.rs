//! pbrt-v4: a scene with the block as an `rgbgrid` medium, in one text file.
//!
//! Of the renderers' formats the only one that takes σa and σs' as they are.

use std::io::{self, Write};
use std::path::Path;

use rayon::prelude::*;

use crate::header::About;
use crate::template::{filled, picture_size};
use crate::{Face, FileError, Overwrite, ScatteringMedium, atomic_write};

/// pbrt's grids fade to nothing in their outer half voxel: one more voxel, as at the edge, lies
/// around the block, and the block ends where the material does.
const MARGIN: usize = 1;

const HEAD: &str = "\
# A translucent block, lit on its {LIT} face, seen from the front. For pbrt-v4: pbrt scene.pbrt
# {ABOUT}
# pbrt's frame is left-handed: without this the block would be mirrored.
Scale -1 1 1
LookAt {CX} {CY} {EYE}  {CX} {CY} 0  0 1 0
Camera \"orthographic\" \"float screenwindow\" [ -{CX} {CX} -{CY} {CY} ]
Film \"rgb\" \"string filename\" \"slab.exr\" \"integer xresolution\" {WIDTH} \"integer yresolution\" {HEIGHT}
Sampler \"independent\" \"integer pixelsamples\" 64
# Light that scatters hundreds of times is the rule here.
Integrator \"volpath\" \"integer maxdepth\" 100000

WorldBegin
# Unit irradiance, from a surface that is black: what the block sends back does not return.
AttributeBegin
  Material \"diffuse\" \"rgb reflectance\" [ 0 0 0 ]
  AreaLightSource \"diffuse\" \"rgb L\" [ 0.318309886 0.318309886 0.318309886 ]
  Shape \"trianglemesh\" \"point3 P\" [ 0 0 {LZ}  {X} 0 {LZ}  {X} {Y} {LZ}  0 {Y} {LZ} ]
    \"integer indices\" [ {LIGHT} ]
AttributeEnd

MakeNamedMedium \"material\" \"string type\" \"rgbgrid\" \"float g\" 0 \"float scale\" 1
  \"integer nx\" {NX} \"integer ny\" {NY} \"integer nz\" {NZ}
  \"point3 p0\" [ {P0} ] \"point3 p1\" [ {P1} ]
";

const BLOCK: &str = "
AttributeBegin
  MediumInterface \"material\" \"\"
  Material {SURFACE}
  Shape \"trianglemesh\"
    \"point3 P\" [ 0 0 0  {X} 0 0  {X} {Y} 0  0 {Y} 0  0 0 {Z}  {X} 0 {Z}  {X} {Y} {Z}  0 {Y} {Z} ]
    \"integer indices\" [ 0 2 1 0 3 2  4 5 6 4 6 7  0 1 5 0 5 4  1 2 6 1 6 5  2 3 7 2 7 6  3 0 4 3 4 7 ]
AttributeEnd
";

/// Writes the scene; coefficients per scene unit. What it says of the material stands in a
/// comment.
///
/// # Errors
/// Another number of channels than 1 or 3, the file is there already and `overwrite` refuses, or
/// the system does.
pub fn write(
    path: &Path,
    medium: &ScatteringMedium<'_>,
    overwrite: Overwrite,
) -> Result<(), FileError> {
    let channels = medium.one_or_three(path, "pbrt")?;
    let cells = medium.material().grid().cells().map(|n| n + 2 * MARGIN);
    atomic_write(path, overwrite, |file| {
        // Not every parser of its files knows letters beyond ASCII, be it in a comment.
        let values = values(medium, cells, &About::of(medium).ascii()?);
        file.write_all(filled(HEAD, &values).as_bytes())?;
        type Quantity = fn((f64, f64)) -> f64;
        let quantities: [(&str, Quantity); 2] = [("sigma_a", |(a, _)| a), ("sigma_s", |(_, s)| s)];
        for (name, quantity) in quantities {
            writeln!(file, "  \"rgb {name}\" [")?;
            let slice = |z: usize| slice(medium, channels, cells, z, quantity);
            let slices: Vec<Vec<u8>> =
                (0..cells[2]).into_par_iter().map(slice).collect::<io::Result<_>>()?;
            slices.iter().try_for_each(|slice| file.write_all(slice))?;
            writeln!(file, "  ]")?;
        }
        file.write_all(filled(BLOCK, &values).as_bytes())
    })
}

/// The numbers of a slice, a row a line.
fn slice(
    medium: &ScatteringMedium<'_>,
    channels: usize,
    [nx, ny, _]: [usize; 3],
    z: usize,
    quantity: impl Fn((f64, f64)) -> f64,
) -> io::Result<Vec<u8>> {
    let cells = medium.material().grid().cells();
    let nearest = |at: usize, axis: usize| at.saturating_sub(MARGIN).min(cells[axis] - 1);
    let mut out = Vec::with_capacity(nx * ny * 33);
    for y in 0..ny {
        for x in 0..nx {
            let index = medium.index([nearest(x, 0), nearest(y, 1), nearest(z, 2)]);
            for c in 0..3 {
                let value = quantity(medium.sigma(c.min(channels - 1), index)) as f32;
                // The same digits as by `write!`, three times as fast.
                serde_json::to_writer(&mut out, &value)?;
                out.push(b' ');
            }
        }
        out.push(b'\n');
    }
    Ok(out)
}

fn values(
    medium: &ScatteringMedium<'_>,
    [nx, ny, nz]: [usize; 3],
    about: &str,
) -> Vec<(&'static str, String)> {
    let ([x, y, z], [hx, hy, hz]) = (medium.size(), medium.spacing());
    let largest = x.max(y).max(z);
    let gap = 1e-3 * largest;
    // The light is opaque: where it is on the camera's side, the camera is between it and the block.
    let (lit, light_z, light, eye) = match medium.material().lit_face() {
        Face::Back => ("back", -gap, "0 1 2 0 2 3", z + 2.0 * largest),
        Face::Front => ("front", z + gap, "0 2 1 0 3 2", z + 0.5 * gap),
    };
    let eta = medium.material().optics().eta;
    let surface = match eta {
        eta if eta > 1.0 => format!("\"dielectric\" \"float eta\" {eta}"),
        _ => "\"interface\"".into(),
    };
    let [width, height] = picture_size(x, y);
    let margin = MARGIN as f64;
    vec![
        ("LIT", lit.into()),
        ("ABOUT", about.into()),
        ("CX", (x / 2.0).to_string()),
        ("CY", (y / 2.0).to_string()),
        ("EYE", eye.to_string()),
        ("WIDTH", width),
        ("HEIGHT", height),
        ("X", x.to_string()),
        ("Y", y.to_string()),
        ("Z", z.to_string()),
        ("LZ", light_z.to_string()),
        ("LIGHT", light.into()),
        ("NX", nx.to_string()),
        ("NY", ny.to_string()),
        ("NZ", nz.to_string()),
        ("P0", format!("{} {} {}", -margin * hx, -margin * hy, -margin * hz)),
        ("P1", format!("{} {} {}", x + margin * hx, y + margin * hy, z + margin * hz)),
        ("SURFACE", surface),
    ]
}
