//! `diaphane info`: what a material is like.

use crate::Failure;
use crate::output::{Done, counted};
use crate::regime::Regime;
use crate::statistics::Spread;
use material::{
    BoundaryConvention, Channel, Face, Format, LateralBoundary, Material, Reading, Scheme,
    impossible_voxels,
};
use serde::Serialize;
use std::fmt::Write;
use std::path::PathBuf;

/// Tell what a material is like, whichever format it is in
///
/// Ranges and histograms of kappa and mu, voxels that no scattering medium has, mean free paths in
/// mm and in voxels, and whether the diffusion approximation is right for such a block.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  diaphane info my-wax/material/export/material.vdb")]
pub(crate) struct Args {
    /// File that holds a material
    file: PathBuf,
}

/// All of it, for `--json`.
#[derive(Serialize)]
struct Info {
    format: &'static str,
    cells: [usize; 3],
    spacing_mm: [f64; 3],
    size_mm: [f64; 3],
    optics: material::Optics,
    lit_face: Face,
    provenance: material::Provenance,
    /// What the file does not tell.
    assumed: Vec<String>,
    channels: Vec<About>,
}

/// One channel.
#[derive(Serialize)]
struct About {
    name: String,
    gain: f64,
    kappa_mm: Spread,
    mu_per_mm: Spread,
    /// Diffuse reflectance of the surface itself, where it is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    surface_reflectance: Option<Range>,
    /// Voxels with 3κμ > 1, which no scattering medium has.
    impossible_voxels: usize,
    impossible_share: f64,
    /// 3κ of the median voxel.
    mean_free_path_mm: f64,
    /// The same in cells along x, y and z.
    mean_free_path_voxels: [f64; 3],
    /// The block's thickness in mean free paths, by the mean extinction.
    optical_thickness: f64,
    /// By the means of absorption and extinction.
    albedo: f64,
    /// Errors of the diffusion model that such a block makes one expect, relative.
    diffusion_error_in_brightness: f64,
    diffusion_error_rms: f64,
    /// Whether these are small; the reasons if not.
    diffusion_holds: bool,
    diffusion_warning: Option<String>,
}

/// Of values that may be 0, which [`Spread`]'s histogram has no place for.
#[derive(Serialize)]
struct Range {
    min: f64,
    median: f64,
    max: f64,
}

impl Range {
    fn of(values: &[f32]) -> Option<Self> {
        let mut sorted = values.to_vec();
        sorted.sort_unstable_by(f32::total_cmp);
        let at = |i: usize| sorted.get(i).map(|v| f64::from(*v));
        let last = sorted.len().checked_sub(1)?;
        Some(Self { min: at(0)?, median: at(last / 2)?, max: at(last)? })
    }
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let format = Format::to_read(&args.file)?;
    let reading = format.load(&args.file)?;
    let info = Info::of(format, &reading);
    let text = info.text(&args.file.display().to_string()).map_err(Failure::other)?;
    let json = serde_json::to_value(&info).map_err(Failure::other)?;
    Ok(Done::new(json, text))
}

impl Info {
    fn of(format: Format, Reading { material, assumed }: &Reading) -> Self {
        let grid = material.grid();
        Self {
            format: match format {
                Format::Mitsuba => "vol",
                other => other.ending(),
            },
            cells: grid.cells(),
            spacing_mm: grid.spacing_mm(),
            size_mm: grid.size_mm(),
            optics: *material.optics(),
            lit_face: material.lit_face(),
            provenance: material.provenance().clone(),
            assumed: assumed.clone(),
            channels: (0..material.channels().len())
                .filter_map(|c| About::of(material, c))
                .collect(),
        }
    }

    fn text(&self, file: &str) -> Result<String, std::fmt::Error> {
        let mut out = String::new();
        let by = |values: [String; 3]| values.join(" × ");
        let short = |values: [f64; 3]| by(values.map(number));
        writeln!(
            out,
            "{file}: {} voxels of {} mm, a block of {} mm",
            by(self.cells.map(|n| n.to_string())),
            short(self.spacing_mm),
            short(self.size_mm)
        )?;
        let optics = &self.optics;
        let convention = match optics.boundary {
            BoundaryConvention::Transport => "transport",
            BoundaryConvention::Wang2008 => "wang2008",
            BoundaryConvention::Wang2010 => "wang2010",
        };
        let face = if self.lit_face == Face::Front { "front" } else { "back" };
        let sides = match optics.lateral {
            LateralBoundary::Open => "open sides",
            LateralBoundary::NoFlux => "no flux through its sides",
        };
        writeln!(
            out,
            "refractive index {}, C {}, convention {convention}; lit from the {face}, {sides}{}",
            number(optics.eta),
            number(optics.boundary_constant),
            if optics.scheme == Scheme::Stam { "; scheme stam: Δ(κφ) − μφ = 0" } else { "" }
        )?;
        let made = &self.provenance;
        let by = format!("{} {}", made.software, made.version);
        writeln!(out, "made by {} from {}", by.trim_end(), counted(made.inputs.len(), "input"))?;
        self.assumed.iter().try_for_each(|line| writeln!(out, "not told, assumed: {line}"))?;
        for channel in &self.channels {
            channel.text(&mut out)?;
        }
        Ok(out.trim_end().to_owned())
    }
}

impl About {
    fn of(material: &Material, index: usize) -> Option<Self> {
        let channel: &Channel = material.channels().get(index)?;
        let surface = material.surface().and_then(|all| all.get(index));
        let impossible_voxels = impossible_voxels(channel);
        let regime = Regime::of(material, channel);
        let (scale, rms) = regime.errors();
        let warning = regime.warning(&channel.name);
        let kappa_mm = Spread::of(&channel.kappa_mm)?;
        let mean_free_path_mm = 3.0 * kappa_mm.median;
        Some(Self {
            name: channel.name.clone(),
            gain: channel.gain,
            mu_per_mm: Spread::of(&channel.mu_per_mm)?,
            surface_reflectance: surface.and_then(|s| Range::of(&s.reflectance)),
            impossible_voxels,
            impossible_share: impossible_voxels as f64 / material.grid().len() as f64,
            mean_free_path_mm,
            mean_free_path_voxels: material.grid().spacing_mm().map(|h| mean_free_path_mm / h),
            kappa_mm,
            optical_thickness: regime.thickness,
            albedo: 1.0 - regime.absorption,
            diffusion_error_in_brightness: scale,
            diffusion_error_rms: rms,
            diffusion_holds: warning.is_none(),
            diffusion_warning: warning,
        })
    }

    fn text(&self, out: &mut String) -> std::fmt::Result {
        writeln!(out, "\n{}", self.name)?;
        let spread = |out: &mut String, name: &str, unit: &str, spread: &Spread| {
            let Spread { min, median, max, .. } = spread;
            let [min, median, max] = [min, median, max].map(|v| number(*v));
            writeln!(out, "  {name:<6} {min} to {max} {unit}, median {median}")?;
            writeln!(out, "         {min} |{}| {max}", spread.histogram.bars())
        };
        spread(out, "kappa", "mm", &self.kappa_mm)?;
        spread(out, "mu", "1/mm", &self.mu_per_mm)?;
        if let Some(Range { min, median, max }) = &self.surface_reflectance {
            let [min, median, max] = [min, median, max].map(|v| number(*v));
            writeln!(out, "  surface reflectance {min} to {max}, median {median}")?;
        }
        writeln!(
            out,
            "  voxels that no scattering medium has (3κμ > 1): {} ({} %)",
            self.impossible_voxels,
            number(100.0 * self.impossible_share)
        )?;
        let [x, y, z] = self.mean_free_path_voxels;
        let same = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-6;
        let voxels =
            if same(x, y) && same(y, z) { number(x) } else { [x, y, z].map(number).join(" × ") };
        let path = number(self.mean_free_path_mm);
        writeln!(out, "  mean free path {path} mm, {voxels} voxels")?;
        writeln!(
            out,
            "  optical thickness {} mean free paths, albedo {:.4}",
            number(self.optical_thickness),
            self.albedo
        )?;
        match &self.diffusion_warning {
            None => writeln!(
                out,
                "  the diffusion model holds: {} % in brightness, {} % root mean square",
                number(100.0 * self.diffusion_error_in_brightness),
                number(100.0 * self.diffusion_error_rms)
            ),
            Some(warning) => writeln!(out, "  {warning}"),
        }
    }
}

/// With three digits.
fn number(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let digits = 2 - value.abs().log10().floor() as i32;
    if (-3..7).contains(&digits) {
        let text = format!("{value:.*}", digits.max(0) as usize);
        let text = if text.contains('.') { text.trim_end_matches('0') } else { &text };
        return text.trim_end_matches('.').to_owned();
    }
    format!("{value:.2e}")
}
