//! A small material whose every number is its own, so that a mix-up cannot pass.

use std::collections::BTreeMap;

use material::{
    Channel, Face, Grid, Impossible, Input, Material, Optics, Provenance, Resolution,
    ScatteringMedium, SceneUnit, Surface,
};

pub fn sample(names: &[&str]) -> Material {
    with_grid(Grid::new([5, 4, 3], [0.1, 0.25, 1.0 / 3.0]).unwrap(), names)
}

/// The same on another grid.
#[allow(dead_code, reason = "most tests do with the small one")]
pub fn with_grid(grid: Grid, names: &[&str]) -> Material {
    // Small enough that every voxel could be one that scatters.
    let step = (60.0 / grid.len() as f32).min(1.0);
    let cells = || (0..grid.len()).map(|i| i as f32 * step);
    let channel = |c: usize, name: &str| Channel {
        name: name.into(),
        kappa_mm: cells().map(|i| 0.1 + 0.001 * i + 0.1 * c as f32).collect(),
        mu_per_mm: cells().map(|i| 1e-3 + 1e-5 * i + 1e-2 * c as f32).collect(),
        gain: 1.0 + c as f64 / 7.0,
    };
    let channels = names.iter().enumerate().map(|(c, name)| channel(c, name)).collect();
    let settings = [("lambda", "1e-5"), ("method", "l-bfgs, κ and μ")];
    let provenance = Provenance {
        software: "diaphane".into(),
        version: "0.1.0".into(),
        captured_unix_s: 1_790_000_000,
        seed: Some(u64::MAX),
        inputs: vec![Input { name: "measurement/radiance.exr".into(), blake3: "0".repeat(64) }],
        settings: settings
            .map(|(k, v)| (k.to_owned(), v.to_owned()))
            .into_iter()
            .collect::<BTreeMap<_, _>>(),
    };
    Material::new(grid, channels, Optics::from_eta(1.0 / 0.7), Face::Back, provenance).unwrap()
}

/// The same with a resolution.
#[allow(dead_code, reason = "not every format holds it")]
pub fn resolved(names: &[&str]) -> Material {
    let resolution = |c: usize| Resolution {
        kappa_mm: (0..60).map(|i| 1.0 + 0.01 * i as f32 + c as f32).collect(),
        mu_mm: (0..60).map(|i| if i < 50 { 5.0 + i as f32 } else { f32::INFINITY }).collect(),
    };
    sample(names).with_resolution((0..names.len()).map(resolution).collect()).unwrap()
}

/// The same lit from the front, with a surface.
#[allow(dead_code, reason = "not every format holds it")]
pub fn surfaced(names: &[&str]) -> Material {
    let plain = sample(names);
    let surface = |c: usize| Surface {
        reflectance: (0..20).map(|i| 0.01 * i as f32 + 0.3 * c as f32).collect(),
    };
    let (grid, optics) = (*plain.grid(), *plain.optics());
    let (channels, provenance) = (plain.channels().to_vec(), plain.provenance().clone());
    let lit = Material::new(grid, channels, optics, Face::Front, provenance).unwrap();
    lit.with_surface((0..names.len()).map(surface).collect()).unwrap()
}

/// A material as a renderer takes it; none of its voxels is impossible.
#[allow(dead_code, reason = "not every test writes for renderers")]
pub fn medium(material: &Material, unit: SceneUnit) -> ScatteringMedium<'_> {
    ScatteringMedium::of(material, unit, Impossible::Refuse, "here".as_ref()).unwrap()
}
