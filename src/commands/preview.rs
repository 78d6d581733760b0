//! `diaphane preview`: what the camera sees now, and lines from the projector to align by.

use crate::Failure;
use crate::cli::STOP;
use crate::commands::calibrate;
use crate::devices;
use crate::output::{Done, check_output, check_png_name};
use crate::session::Session;
use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
use material::{Overwrite, atomic_write};
use rig::{Frame, PixelRect, ProjectorImage, ProjectorInfo, Rig, RigFile, Target};
use serde_json::json;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Show what the camera sees, again and again, while the projector shows lines to align by
///
/// The picture is written to a file that an image viewer reloads by itself: below the camera's view,
/// where clipped pixels are red, stand a histogram and the last focus scores. Turn the lens until
/// the score is highest. The projector shows a cross in the middle of its frame; in a session that
/// is calibrated also the borders of the regions on the block.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  diaphane preview my-marble --exposure 0.1\n  diaphane preview rig.toml --once --picture now.png"
)]
pub(crate) struct Args {
    /// Folder of a session, or a rig file
    rig: PathBuf,
    /// Exposure, seconds
    #[arg(long, default_value_t = 0.1)]
    exposure: f64,
    /// Where the picture goes, a PNG
    #[arg(long, default_value = "preview.png")]
    picture: PathBuf,
    /// Seconds between two pictures
    #[arg(long, default_value_t = 1.0)]
    every: f64,
    /// One picture, and end
    #[arg(long)]
    once: bool,
    /// Light everything instead of lines
    #[arg(long)]
    white: bool,
    /// Replace a picture that is there
    #[arg(long)]
    force: bool,
}

/// Columns of the picture at most: more is no help and slow to write.
const WIDEST: usize = 1280;
/// Rows of the histogram and of the focus curve.
const PANEL: usize = 120;
/// Focus scores that are shown.
const REMEMBERED: usize = 120;
/// Half the width of a line, projector pixels.
const HALF_LINE: u32 = 1;

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    if !(args.exposure.is_finite() && args.exposure > 0.0) {
        return Err(Failure::input(format!(
            "--exposure: a positive number of seconds, found {}",
            args.exposure
        )));
    }
    let Ok(every) = Duration::try_from_secs_f64(args.every) else {
        return Err(Failure::input(format!("--every: seconds, found {}", args.every)));
    };
    let overwrite = if args.force { Overwrite::Replace } else { Overwrite::Refuse };
    let named = Named::look(&args.rig)?;
    check_png_name(&args.picture, "--picture")?;
    check_output(&args.picture, overwrite)?;
    let (mut rig, session) = named.open()?;
    rig.bench.place(&Target::Sample)?;
    let info = rig.projector.info();
    let lines = match (args.white, &session) {
        (true, _) => ProjectorImage {
            width: info.width,
            height: info.height,
            data: vec![255; info.width as usize * info.height as usize],
        },
        (false, session) => lines(&info, session.as_ref())?,
    };
    rig.projector.show(&lines)?;
    let mut scores: Vec<f64> = Vec::new();
    // Its own picture it replaces.
    let mut overwrite = overwrite;
    loop {
        let began = Instant::now();
        let frame = rig.camera.expose(args.exposure)?;
        frame.check()?;
        let stats = frame.stats();
        scores.push(stats.focus);
        if scores.len() > REMEMBERED {
            scores.remove(0);
        }
        write(&args.picture, &frame, &scores, overwrite)?;
        overwrite = Overwrite::Replace;
        let best = scores.iter().copied().fold(0.0, f64::max);
        eprintln!(
            "focus {:.4} (best {best:.4}), mean {:.1} % of full scale, {:.2} % clipped",
            stats.focus,
            100.0 * stats.mean / f64::from(frame.max_value()),
            100.0 * stats.clipped_share
        );
        if args.once || STOP.load(Ordering::Relaxed) {
            let text = format!("picture: {}", args.picture.display());
            let json = json!({
                "picture": args.picture,
                "exposure_s": frame.exposure_s,
                "focus": stats.focus,
                "best_focus": best,
                "mean": stats.mean / f64::from(frame.max_value()),
                "clipped_share": stats.clipped_share,
            });
            return Ok(Done::new(json, text));
        }
        while began.elapsed() < every && !STOP.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

/// What the command line names: it is read before anything is written or switched on.
#[allow(clippy::large_enum_variant, reason = "there is one in a program")]
enum Named {
    Session(Session),
    File(RigFile, String),
}

impl Named {
    fn look(path: &Path) -> Result<Self, Failure> {
        let name = path.display().to_string();
        if !path.exists() {
            let error = format!("{name}: there is no such session and no such rig file");
            return Err(Failure::input(error).hint(format!(
                "make a session with: diaphane init {name}; docs/devices.md has examples of rig files"
            )));
        }
        if path.is_dir() {
            return Ok(Self::Session(Session::open(path)?));
        }
        let file = RigFile::read(path)?;
        // As `init` does: without these there is nothing to see, whatever is connected.
        if file.camera.is_none() || file.projector.display.is_none() {
            let error = format!("{name}: a preview needs a [camera] and a [projector.display]");
            return Err(Failure::input(error).hint("docs/devices.md has examples"));
        }
        Ok(Self::File(file, name))
    }

    /// The devices, and the session if it is one.
    fn open(self) -> Result<(Rig, Option<Session>), Failure> {
        match self {
            Self::Session(session) => Ok((devices::open(&session)?, Some(session))),
            Self::File(file, name) => Ok((devices::assemble(&file, &name)?, None)),
        }
    }
}

/// The colour of the line between picture and panel.
const SEAM: [u8; 3] = [250, 251, 252];

/// A frame around the projector's picture and a cross in its middle; the borders of the regions
/// where it is known where the face is.
fn lines(info: &ProjectorInfo, session: Option<&Session>) -> Result<ProjectorImage, Failure> {
    let (width, height) = (info.width, info.height);
    let mut image =
        ProjectorImage { width, height, data: vec![0; width as usize * height as usize] };
    let rect = |x0: u32, y0: u32, x1: u32, y1: u32| PixelRect { x0, y0, x1, y1 };
    let thick = 2 * HALF_LINE + 1;
    let (cx, cy) = (width / 2, height / 2);
    for edge in [
        rect(0, 0, width, thick),
        rect(0, height.saturating_sub(thick), width, height),
        rect(0, 0, thick, height),
        rect(width.saturating_sub(thick), 0, width, height),
        rect(cx.saturating_sub(HALF_LINE), 0, cx + HALF_LINE + 1, height),
        rect(0, cy.saturating_sub(HALF_LINE), width, cy + HALF_LINE + 1),
    ] {
        image.paint(edge, 255);
    }
    let Some(session) = session.filter(|session| calibrate::is_done(session)) else {
        return Ok(image);
    };
    let lit = calibrate::lit_plane(session)?;
    let [face_width, face_height, _] = session.config.sample.grid.size_mm();
    let [columns, rows] = session.config.plan.regions;
    let region = |x: u32, y: u32| -> Option<[i64; 2]> {
        let [u, v] = lit.pixel_to_face([f64::from(x), f64::from(y)])?;
        let cell = |at: f64, size: f64, n: usize| {
            // Beside the face there are no regions.
            ((at / size * n as f64).floor() as i64).clamp(-1, n as i64)
        };
        let [i, j] = [cell(u, face_width, columns), cell(v, face_height, rows)];
        let beside = i < 0 || j < 0 || i >= columns as i64 || j >= rows as i64;
        Some(if beside { [-1, -1] } else { [i, j] })
    };
    for y in 0..height.saturating_sub(1) {
        for x in 0..width.saturating_sub(1) {
            let here = region(x, y);
            if here != region(x + 1, y) || here != region(x, y + 1) {
                image.paint(rect(x.saturating_sub(1), y.saturating_sub(1), x + 1, y + 1), 255);
            }
        }
    }
    Ok(image)
}

/// Camera's view, histogram and focus as one picture.
fn write(path: &Path, frame: &Frame, scores: &[f64], overwrite: Overwrite) -> Result<(), Failure> {
    let step = (frame.width as usize).div_ceil(WIDEST).max(1);
    let (width, height) = (frame.width as usize / step, frame.height as usize / step);
    let channels = usize::from(frame.channels);
    let full = f64::from(frame.max_value());
    let mut pixels = vec![[0_u8; 3]; width * (height + PANEL)];
    let mut counts = vec![[0_u32; 3]; width.max(1)];
    for y in 0..height {
        for x in 0..width {
            // Any clipped pixel of the block shows, however small it is in the picture.
            let (mut clipped, mut sum) = (false, [0.0; 3]);
            for dy in 0..step {
                for dx in 0..step {
                    let at = ((y * step + dy) * frame.width as usize + x * step + dx) * channels;
                    for (c, s) in sum.iter_mut().enumerate() {
                        let value = frame.data[at + if channels == 3 { c } else { 0 }];
                        clipped |= value == frame.max_value();
                        *s += f64::from(value) / full;
                        let bin = (f64::from(value) / full * (width - 1) as f64) as usize;
                        counts[bin][c] += 1;
                    }
                }
            }
            let n = (step * step) as f64;
            pixels[y * width + x] =
                if clipped { [255, 0, 0] } else { sum.map(|s| crate::report::colour::srgb(s / n)) };
        }
    }
    panel(&mut pixels[width * height..], width, &counts, scores);
    let size = |n: usize| u32::try_from(n).map_err(Failure::other);
    let mut png = Vec::new();
    PngEncoder::new(&mut png)
        .write_image(
            pixels.as_flattened(),
            size(width)?,
            size(height + PANEL)?,
            ExtendedColorType::Rgb8,
        )
        .map_err(|e| Failure::other(format!("the preview cannot be encoded: {e}")))?;
    Ok(atomic_write(path, overwrite, |file| file.write_all(&png))?)
}

/// Left: the share of values, on a logarithmic scale, over the camera's range from black to full
/// scale. Over it in yellow: the last focus scores, the best at the top.
fn panel(pixels: &mut [[u8; 3]], width: usize, counts: &[[u32; 3]], scores: &[f64]) {
    let most = counts.iter().flatten().copied().max().unwrap_or(0).max(1);
    let high = |count: u32| {
        let share = f64::from(count + 1).ln() / f64::from(most + 1).ln();
        (share * (PANEL - 2) as f64) as usize
    };
    for x in 0..width {
        for y in 1..PANEL {
            let from_below = PANEL - y;
            pixels[y * width + x] =
                counts[x].map(|count| if high(count) >= from_below { 170 } else { 24 });
        }
        pixels[x] = SEAM;
    }
    let best = scores.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    for (i, score) in scores.iter().enumerate() {
        let y = PANEL - 2 - ((score / best) * (PANEL - 4) as f64) as usize;
        let from = i * width / REMEMBERED;
        for x in from..((i + 1) * width / REMEMBERED).min(width) {
            for dy in 0..2 {
                pixels[(y + dy).clamp(1, PANEL - 1) * width + x] = [255, 220, 0];
            }
        }
    }
}
