//! `diaphane calibrate response`: the camera's curve from any bracket of photographs.

use crate::Failure;
use crate::exposures::{exposures, refuse_one_time, response_bracket};
use crate::output::{Done, check_output, output_beside};
use calibration::{ExposureTable, Response, recover_response, recover_response_above};
use material::{Overwrite, atomic_write};
use serde_json::json;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::PathBuf;
use std::time::Instant;

/// Recover a camera's response from photographs of one still scene at several exposures
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  diaphane calibrate response --images photos\n  diaphane calibrate response --images photos --exposures times.txt --output canon.json"
)]
pub(crate) struct Args {
    /// Folder of photographs
    #[arg(long)]
    images: PathBuf,
    /// Exposure times, where EXIF does not tell: lines of "file-name seconds"
    #[arg(long)]
    exposures: Option<PathBuf>,
    /// Code without light, DN, for cameras that add one
    #[arg(long)]
    black: Option<f64>,
    /// The response to write, with a drawing of it (.svg) beside; response.json beside the
    /// photographs if not given
    #[arg(long)]
    output: Option<PathBuf>,
    /// Replace a response that is there
    #[arg(long)]
    force: bool,
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let overwrite = if args.force { Overwrite::Replace } else { Overwrite::Refuse };
    let asked = args.output.as_deref();
    let output = output_beside(asked, &args.images, "response.json", "--images")?;
    let drawing = output.with_extension("svg");
    [&output, &drawing].into_iter().try_for_each(|path| check_output(path, overwrite))?;
    let mut warnings = Vec::new();
    let table = args.exposures.as_ref().map(ExposureTable::load).transpose()?;
    let pictures = exposures(&args.images, table.as_ref(), &mut warnings)?;
    refuse_one_time(&pictures)?;
    let bracket = response_bracket(&pictures)?;
    let started = Instant::now();
    let response = match args.black {
        Some(black) => recover_response_above(&bracket, black)?,
        None => recover_response(&bracket)?,
    };
    let seconds = started.elapsed().as_secs_f64();
    let agreement = response.agreement(&bracket);
    let text = serde_json::to_string(&response).map_err(Failure::other)?;
    atomic_write(&output, overwrite, |out| out.write_all(text.as_bytes()))?;
    atomic_write(&drawing, overwrite, |out| out.write_all(draw(&response).as_bytes()))?;
    let mut text = format!("response from {} pictures: {}", bracket.len(), output.display());
    for (name, median) in names(&response).iter().zip(&agreement) {
        let median = median.map_or("no pixel in two exposures".into(), |m| format!("{m:.4}"));
        let _ = write!(text, "\n{name}: median |log2 ratio error| {median}");
    }
    let kind = if response.is_identity() { "linear: no curve at all" } else { "a curve" };
    let _ = write!(
        text,
        "\n{kind}, strictly increasing: {}, {seconds:.3} s",
        response.is_strictly_increasing()
    );
    let json = json!({
        "output": output,
        "drawing": drawing,
        "channels": names(&response),
        "median_log2_error": agreement,
        "strictly_increasing": response.is_strictly_increasing(),
        "identity": response.is_identity(),
        "seconds": seconds,
        "warnings": warnings,
    });
    Ok(Done::new(json, text))
}

fn names(response: &Response) -> &'static [&'static str] {
    if response.channels() == 1 { &["Y"] } else { &["R", "G", "B"] }
}

/// Code over ln exposure, one line a channel.
fn draw(response: &Response) -> String {
    const COLOURS: [&str; 3] = ["#c0392b", "#1e8449", "#2471a3"];
    let mut svg = String::from(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 420 300\" font-family=\"sans-serif\" font-size=\"11\">\
         <rect width=\"420\" height=\"300\" fill=\"#fff\"/>\
         <path d=\"M40 20V260H400\" fill=\"none\" stroke=\"#888\"/>\
         <text x=\"150\" y=\"285\">exposure, stops from mid grey</text>\
         <text x=\"12\" y=\"180\" transform=\"rotate(-90 16 180)\">code</text>",
    );
    for stop in (-8..=2).step_by(2) {
        let x = 40.0 + 360.0 * (f64::from(stop) + 9.0) / 11.5;
        let _ = write!(svg, "<text x=\"{x:.1}\" y=\"272\" text-anchor=\"middle\">{stop}</text>");
    }
    for c in 0..response.channels() {
        let mut path = String::new();
        for (k, log) in response.log_exposure(c).iter().enumerate() {
            let stops = log / std::f64::consts::LN_2;
            if (-9.0..=2.5).contains(&stops) {
                let x = 40.0 + 360.0 * (stops + 9.0) / 11.5;
                let y = 260.0 - 240.0 * k as f64 / 255.0;
                let _ = write!(path, "{}{x:.1} {y:.1}", if path.is_empty() { "M" } else { "L" });
            }
        }
        let colour = if response.channels() == 1 { "#333" } else { COLOURS[c % 3] };
        let _ = write!(svg, "<path d=\"{path}\" fill=\"none\" stroke=\"{colour}\"/>");
    }
    svg + "</svg>\n"
}
