//! `diaphane merge --images`: any folder of bracketed photographs.

use super::merge::Args;
use crate::Failure;
use crate::exposures::{
    Exposure, exposures, master_darks, read_noise, refuse_one_time, response_bracket,
};
use crate::output::{Done, Progress, check_output, counted, output_beside};
use crate::reading::Reading;
use calibration::{
    Bayer, Brightness, CalibrationError, ExposureTable, ExrPrecision, FlatField, HdrImage,
    MergeReport, Merger, NoiseModel, Response, check_brightness, list_pictures, quads,
    recover_response, recover_response_above, write_exr_as,
};
use material::Overwrite;
use serde_json::json;
use std::path::Path;

pub(crate) fn run(images: &Path, args: &Args, overwrite: Overwrite) -> Result<Done, Failure> {
    let output = output_beside(args.output.as_deref(), images, "merged.exr", "--images")?;
    check_output(&output, overwrite)?;
    let mut warnings = Vec::new();
    let table = args.exposures.as_ref().map(ExposureTable::load).transpose()?;
    let bracket = exposures(images, table.as_ref(), &mut warnings)?;
    let asked =
        args.bayer.as_deref().map(Bayer::parse).transpose().map_err(CalibrationError::from)?;
    let Some(one) = bracket.first() else {
        return Err(Failure::input(format!("{}: no photographs", images.display())));
    };
    let reading = Reading::of(&one.path)?;
    let bayer = reading.bayer(asked)?;
    if bracket.len() < 2 {
        return Err(Failure::input(format!(
            "{}: expected at least two exposures, found {}",
            images.display(),
            bracket.len()
        )));
    }
    refuse_one_time(&bracket)?;
    let noise = reading.noise(args.noise.as_deref().map(read_noise).transpose()?);
    let response = response(&bracket, args, bayer, &reading, &noise)?;
    let (image, report) =
        merged(&bracket, args, table.as_ref(), &reading, &response, &noise, &mut warnings)?;
    let image = match bayer {
        Some(bayer) => quads(bayer, &image)?,
        None => image,
    };
    let precision = if args.half { ExrPrecision::Half } else { ExrPrecision::Float };
    write_exr_as(&output, &image, precision, overwrite)?;
    let mut text = format!(
        "{} pictures merged into {}: {:.2} % of the values measured, {} clipped even in the shortest, {} lost in noise even in the longest",
        bracket.len(),
        output.display(),
        100.0 * image.measured_share(),
        counted(image.clipped_shortest, "pixel"),
        image.lost_longest
    );
    text += &told(&report);
    let exposures: Vec<_> = report
        .exposures
        .iter()
        .map(|(name, check)| {
            json!({
                "picture": name,
                "exposure_s": check.exposure_s,
                "gain": check.gain,
                "step": check.step,
                "step_sigma": check.step_sigma,
            })
        })
        .collect();
    let json = json!({
        "output": output,
        "finite_share": image.finite_share(),
        "measured_share": image.measured_share(),
        "response_strictly_increasing": response.is_strictly_increasing(),
        "response_identity": response.is_identity(),
        "clipped_shortest": image.clipped_shortest,
        "lost_longest": image.lost_longest,
        "exposures": exposures,
        "noise_ratio": report.noise_ratio,
        "moved_samples": report.moved_samples,
        "warnings": warnings,
    });
    Ok(Done::new(json, text))
}

/// What the merge found out, in words.
fn told(report: &MergeReport) -> String {
    let mut text = String::new();
    let mut longer = 1.0;
    for (name, check) in report.exposures.iter().rev() {
        if check.gain != longer
            && let Some(step) = check.step
        {
            text += &format!(
                "\n{name}: {:+.2} ± {:.2} % of the light that {} s promise beside the next longer exposure; corrected",
                100.0 * (step - 1.0),
                100.0 * check.step_sigma,
                check.exposure_s
            );
        }
        longer = check.gain;
    }
    let worst = report.moved_by_exposure.iter().enumerate().max_by_key(|(_, count)| **count);
    if let Some((worst, _)) = worst.filter(|_| report.moved_samples > 0)
        && let Some((name, _)) = report.exposures.get(worst)
    {
        text += &format!(
            "\nbetween exposures {} differ beyond all noise, most of them in {name}: something moved, or the noise model is another camera's; their variance says so",
            counted(report.moved_samples, "sample")
        );
    }
    if let Some(ratio) = report.noise_ratio.filter(|r| !(0.5..2.0).contains(r)) {
        text += &format!(
            "\nthe noise is {ratio:.2} times what the noise model says: measure it with diaphane calibrate noise"
        );
    }
    text
}

fn response(
    bracket: &[Exposure],
    args: &Args,
    bayer: Option<Bayer>,
    reading: &Reading,
    noise: &NoiseModel,
) -> Result<Response, Failure> {
    if let Some(path) = &args.response {
        if reading.sensor.is_some() {
            let error = format!("--response: {} is a raw file, and linear", reading.first.name);
            return Err(Failure::input(error).hint("leave --response out"));
        }
        let told = path.display();
        let text = std::fs::read_to_string(path)
            .map_err(|e| Failure::input(format!("{told}: cannot be read: {e}")))?;
        return serde_json::from_str(&text).map_err(|e| {
            Failure::input(format!("{told}: expected a response: {e}"))
                .hint("make it with: diaphane calibrate response --images DIR")
        });
    }
    if args.linear || bayer.is_some() {
        return Ok(Response::identity(reading.first.channels));
    }
    let frames = response_bracket(bracket)?;
    Ok(if noise.black_level > 0.0 {
        recover_response_above(&frames, noise.black_level)?
    } else {
        recover_response(&frames)?
    })
}

fn merged(
    bracket: &[Exposure],
    args: &Args,
    table: Option<&ExposureTable>,
    reading: &Reading,
    response: &Response,
    noise: &NoiseModel,
    warnings: &mut Vec<String>,
) -> Result<(HdrImage, MergeReport), Failure> {
    // Where the result goes there is room for what it is made from.
    let beside = args.output.as_deref().and_then(Path::parent).filter(|p| p.is_dir());
    let folder = beside.or(args.images.as_deref()).unwrap_or(Path::new("."));
    let mut merger = Merger::new(response, noise)?.spool_in(folder);
    if let Some(darks) = &args.darks {
        merger = merger.with_darks(master_darks(&exposures(darks, table, warnings)?, reading)?)?;
    }
    if let Some(flats) = &args.flats {
        let pictures = list_pictures(flats)?;
        let photos = pictures.iter().map(|path| reading.photo(path));
        merger = merger.with_flat(FlatField::average(photos, None, response, noise)?);
    }
    let mut progress = Progress::new("read", bracket.len());
    let mut seen = Vec::new();
    for (done, exposure) in bracket.iter().enumerate() {
        progress.set(done, &exposure.name);
        let photo = reading.photo(&exposure.path)?;
        seen.push(Brightness::of(&photo, exposure.seconds));
        merger.add(photo, exposure.seconds)?;
    }
    check_brightness(&seen)?;
    progress.finish("merging");
    Ok(merger.finish()?)
}
