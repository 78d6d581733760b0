//! What is measured on one grid.

use crate::block::{REGIONS, Sample, grid, marble};
use crate::memory;
use diffusion::{
    CpuSolver, Evaluation, Forward, Gpu, GpuSolver, Illuminations, InverseSettings, LinearSolver,
    Measurement, average, evaluate, evaluate_on_gpu, invert, invert_on_gpu,
};
use material::{Face, Grid, Optics};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde_json::{Value, json};
use std::fmt;
use std::time::Instant;

pub(crate) const SEED: u64 = 2008;
/// Standard deviation of every pixel relative to its radiance.
const NOISE: f64 = 0.02;
/// The images come from a grid this many times as fine along every axis: no inverse crime.
const FINER: usize = 2;
const TOLERANCE: f64 = 1e-6;
/// The best of this many evaluations counts.
const REPEATS: usize = 4;
/// Bytes that an iteration moves for an unknown of a right-hand side: 19 values of the finest
/// grid's fields are read or written, a seventh more on the coarser ones, 4 bytes each (the
/// coefficients are shared by 16 right-hand sides).
const BYTES: f64 = 4.0 * (19.0 + 14.0 / 7.0);

/// The device, and what its memory gives.
pub(crate) struct Bench {
    gpu: Option<Gpu>,
    bandwidth: f64,
}

/// One grid's figures.
pub(crate) struct Row {
    cells: [usize; 3],
    lit: Face,
    paper_h: Option<f64>,
    fields: usize,
    evaluation: Evaluation,
    bandwidth: f64,
    inverse: Option<Inverse>,
}

/// All channels of an inverse solve.
struct Inverse {
    seconds: f64,
    fit: f64,
    chi2: f64,
    solves: usize,
    fine_solves: f64,
    /// Iterations of one of these.
    iterations: f64,
    peak_bytes: Option<u64>,
}

impl Bench {
    pub fn new(gpu: Option<Gpu>, bandwidth: f64) -> Self {
        Self { gpu, bandwidth }
    }

    pub fn row(&self, sample: &Sample, inverse: bool) -> Result<Row, String> {
        let Sample { cells, lit, paper_h } = *sample;
        let grid = grid(cells, 1).map_err(|e| e.to_string())?;
        let optics = Optics::from_eta(1.3);
        let channels = if inverse { 3 } else { 1 };
        let images = (0..channels)
            .map(|channel| self.images(&grid, lit, &optics, channel, inverse))
            .collect::<Result<Vec<Measurement>, String>>()?;
        let medium = marble(&grid, 0);
        let times = match &self.gpu {
            None => {
                let mut solver = CpuSolver::<f32>::new();
                evaluate(&grid, &optics, &images[0], &medium, TOLERANCE, REPEATS, &mut solver)
            }
            Some(gpu) => {
                evaluate_on_gpu(&grid, &optics, &images[0], &medium, TOLERANCE, REPEATS, gpu)
            }
        };
        let evaluation = times.map_err(|e| e.to_string())?;
        let inverse = if inverse { Some(self.invert(&grid, &optics, &images)?) } else { None };
        let fields = images[0].light().count();
        Ok(Row { cells, lit, paper_h, fields, evaluation, bandwidth: self.bandwidth, inverse })
    }

    fn invert(
        &self,
        grid: &Grid,
        optics: &Optics,
        images: &[Measurement],
    ) -> Result<Inverse, String> {
        let settings = InverseSettings::default();
        let mut out = Inverse {
            seconds: 0.0,
            fit: 0.0,
            chi2: 0.0,
            solves: 0,
            fine_solves: 0.0,
            iterations: 0.0,
            peak_bytes: None,
        };
        memory::begin();
        let mut iterations = 0.0;
        let mut solver = CpuSolver::<f32>::new();
        for image in images {
            let began = Instant::now();
            let go_on = &mut |_: &diffusion::Progress| true;
            let found = match &self.gpu {
                None => invert(grid, optics, image, &settings, &mut solver, go_on),
                Some(gpu) => invert_on_gpu(None, grid, optics, image, &settings, gpu, go_on),
            };
            let found = found.map_err(|e| e.to_string())?;
            out.seconds += began.elapsed().as_secs_f64();
            out.fit = out.fit.max(found.fit);
            out.chi2 = out.chi2.max(found.chi2);
            out.solves += found.work.linear_solves;
            out.fine_solves += found.work.fine_solves;
            iterations += found.work.fine_iterations;
        }
        out.iterations = iterations / out.fine_solves;
        out.peak_bytes = memory::peak();
        Ok(out)
    }

    /// Noisy images of the marble, from the finer grid where they are to be explained, and from
    /// the same one where only time counts.
    fn images(
        &self,
        grid: &Grid,
        lit: Face,
        optics: &Optics,
        channel: usize,
        finer: bool,
    ) -> Result<Measurement, String> {
        let text = |e: &dyn fmt::Display| e.to_string();
        let fine = crate::block::grid(grid.cells(), if finer { FINER } else { 1 })
            .map_err(|e| text(&e))?;
        let mut solver: Box<dyn LinearSolver> = match &self.gpu {
            None => Box::new(CpuSolver::<f32>::new()),
            Some(gpu) => Box::new(GpuSolver::new(gpu.clone())),
        };
        let mut forward =
            Forward::new(marble(&fine, channel), optics, &mut solver).map_err(|e| text(&e))?;
        let light = Illuminations::regions(&fine, lit, REGIONS).map_err(|e| text(&e))?;
        let mut rng = ChaCha8Rng::seed_from_u64(SEED + channel as u64);
        let (mut radiance, mut variance) = (Vec::new(), Vec::new());
        // Four at a time: 16 would take four times the memory on the finer grid.
        for maps in light.maps().chunks(4) {
            let some = Illuminations::new(&fine, lit, maps.to_vec()).map_err(|e| text(&e))?;
            for image in forward.images(&some, TOLERANCE).map_err(|e| text(&e))? {
                let image = average(&fine, grid, &image);
                let peak = image.iter().fold(0.0f64, |a, l| a.max(*l));
                let mut noisy = Vec::with_capacity(image.len());
                let mut spread = Vec::with_capacity(image.len());
                for l in image {
                    // Noise in proportion to the light, and a floor as of reading a sensor out.
                    let sigma = NOISE * l.abs() + 1e-4 * peak;
                    let normal: f64 = StandardNormal.sample(&mut rng);
                    noisy.push(l + sigma * normal);
                    spread.push(sigma * sigma);
                }
                radiance.push(noisy);
                variance.push(spread);
            }
        }
        let light = Illuminations::regions(grid, lit, REGIONS).map_err(|e| text(&e))?;
        if lit == Face::Front {
            // Pixels that are lit directly say nothing of what is below.
            for (spread, map) in variance.iter_mut().zip(light.maps()) {
                let lit = spread.iter_mut().zip(map).filter(|(_, e)| **e > 0.0);
                lit.for_each(|(v, _)| *v = f64::INFINITY);
            }
        }
        Measurement::new(grid, light, radiance, &variance).map_err(|e| text(&e))
    }
}

impl Row {
    pub const HEADINGS: &str = "grid          lit    forward s  M unk x rhs/s  of the bound  iterations  gradient s  3 channels s  solves  fine solves  of iterations  peak MiB  fit      chi2/N  W08 h";

    /// Unknowns × right-hand sides a second.
    fn rate(&self) -> f64 {
        let unknowns = self.cells.iter().product::<usize>() * self.fields;
        unknowns as f64 / self.evaluation.forward_s
    }

    /// What the memory allows at this number of iterations.
    fn bound(&self) -> f64 {
        self.bandwidth / (BYTES * self.evaluation.iterations.max(1) as f64)
    }

    pub fn json(&self) -> Value {
        json!({
            "cells": self.cells,
            "lit": self.lit,
            "forward_s": self.evaluation.forward_s,
            "unknowns_rhs_per_s": self.rate(),
            "bound_unknowns_rhs_per_s": self.bound(),
            "iterations": self.evaluation.iterations,
            "gradient_s": self.evaluation.gradient_s,
            "inverse": self.inverse.as_ref().map(|i| json!({
                "seconds": i.seconds,
                "fit": i.fit,
                "chi2": i.chi2,
                "linear_solves": i.solves,
                "fine_solves": i.fine_solves,
                "iterations_per_solve": i.iterations,
                "peak_resident_bytes": i.peak_bytes,
            })),
            "wang2008_hours": self.paper_h,
        })
    }
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [nx, ny, nz] = self.cells;
        let lit = match self.lit {
            Face::Front => "front",
            Face::Back => "back",
        };
        write!(
            f,
            "{:13} {lit:5} {:10.4} {:14.1} {:12.0}% {:11} {:11.4}",
            format!("{nx}x{ny}x{nz}"),
            self.evaluation.forward_s,
            self.rate() / 1e6,
            100.0 * self.rate() / self.bound(),
            self.evaluation.iterations,
            self.evaluation.gradient_s,
        )?;
        if let Some(i) = &self.inverse {
            write!(
                f,
                " {:13.2} {:7} {:12.0} {:14.1} {:>9}  {:.1e}  {:6.2} {:>6}",
                i.seconds,
                i.solves,
                i.fine_solves,
                i.iterations,
                i.peak_bytes.map_or("-".to_owned(), |bytes| (bytes >> 20).to_string()),
                i.fit,
                i.chi2,
                self.paper_h.map_or(String::new(), |hours| hours.to_string())
            )?;
        }
        Ok(())
    }
}
