//! A small material whose every number is its own, so that a mix-up cannot pass.

use std::collections::BTreeMap;

use material::{Channel, Face, Grid, Input, Material, Optics, Provenance, Resolution};

pub fn sample(names: &[&str]) -> Material {
    let grid = Grid::new([5, 4, 3], [0.1, 0.25, 1.0 / 3.0]).unwrap();
    let channel = |c: usize, name: &str| Channel {
        name: name.into(),
        kappa_mm: (0..60).map(|i| 0.1 + 0.001 * i as f32 + 0.1 * c as f32).collect(),
        mu_per_mm: (0..60).map(|i| 1e-3 + 1e-5 * i as f32 + 1e-2 * c as f32).collect(),
        gain: 1.0 + c as f64 / 7.0,
    };
    let channels = names.iter().enumerate().map(|(c, name)| channel(c, name)).collect();
    let settings = [("lambda", "1e-5"), ("method", "l-bfgs, κ and μ")];
    let provenance = Provenance {
        software: "diaphane".into(),
        version: "0.1.0".into(),
        created_unix_s: 1_790_000_000,
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
