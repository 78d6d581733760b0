//! Raw files through the crate rawler, whose decoders are kept from taking the program down.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::path::Path;
use std::sync::{Arc, Once};

use rawler::decoders::{Decoder, FormatHint, RawDecodeParams};
use rawler::rawimage::RawPhotometricInterpretation;
use rawler::rawsource::RawSource;
use rawler::{RawImage, RawImageData};

use crate::directories::damage;
use crate::{Bayer, RawError, RawMosaic};

thread_local! {
    /// Whether this thread is inside a decoder.
    static DECODING: Cell<bool> = const { Cell::new(false) };
}

/// What a decoder says against a file, in words.
type Refused<T> = Result<T, String>;

pub fn mosaic(path: &Path, bytes: Vec<u8>) -> Result<RawMosaic, RawError> {
    guarded(path, bytes, |source, decoder| {
        let params = RawDecodeParams::default();
        let image = decoder.raw_image(source, &params, false).map_err(|e| e.to_string())?;
        let levels_from_active_area = matches!(decoder.format_hint(), FormatHint::DNG);
        let exposure_s = noted_exposure_s(source, decoder)?;
        cropped(image, levels_from_active_area, exposure_s)
    })
}

pub fn exposure_s(path: &Path, bytes: Vec<u8>) -> Result<Option<f64>, RawError> {
    guarded(path, bytes, noted_exposure_s)
}

fn noted_exposure_s(source: &RawSource, decoder: &dyn Decoder) -> Refused<Option<f64>> {
    let metadata = decoder.raw_metadata(source, &RawDecodeParams::default());
    let time = metadata.map_err(|e| e.to_string())?.exif.exposure_time;
    let seconds = time.map(|t| f64::from(t.n) / f64::from(t.d));
    Ok(seconds.filter(|t| t.is_finite() && *t > 0.0))
}

/// Runs a decoder on a file. Its decoders panic on much that does not look as they expect
/// (`assert!`, `todo!`, indices from the file), which must end as an error that names the file;
/// nothing that the panic leaves half done outlives this function.
fn guarded<T>(
    path: &Path,
    bytes: Vec<u8>,
    work: impl FnOnce(&RawSource, &dyn Decoder) -> Refused<T>,
) -> Result<T, RawError> {
    hush_decoders();
    let damage = damage(&bytes);
    let source = RawSource::new_from_shared_vec(Arc::new(bytes)).with_path(path);
    DECODING.set(true);
    let done = catch_unwind(AssertUnwindSafe(|| {
        damage.map_or(Ok(()), Err)?;
        let decoder = rawler::get_decoder(&source).map_err(|e| e.to_string())?;
        work(&source, decoder.as_ref())
    }));
    DECODING.set(false);
    let done = done.unwrap_or_else(|panic| {
        let told = panic.downcast_ref::<String>().map(String::as_str);
        let told = told.or_else(|| panic.downcast_ref::<&str>().copied());
        Err(format!("what its decoder gives up on ({})", told.unwrap_or("no reason")))
    });
    done.map_err(|found| RawError::BadFile {
        path: path.to_path_buf(),
        expected: "a whole camera raw file (DNG, CR2, CR3, NEF, ARW) with a mosaic of 2 x 2 red, green and blue sites",
        found,
    })
}

/// Panics are reported before they are caught. Those of decoders become errors, so that nobody
/// need read about them twice; all others are reported as ever.
fn hush_decoders() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let report = take_hook();
        set_hook(Box::new(move |panic| {
            if !DECODING.get() {
                report(panic);
            }
        }));
    });
}

/// The part of a raw image that sees light, its pattern and levels counted from there.
fn cropped(
    image: RawImage,
    levels_from_active_area: bool,
    exposure_s: Option<f64>,
) -> Refused<RawMosaic> {
    let RawPhotometricInterpretation::Cfa(filter) = &image.photometric else {
        return Err("pixels without a colour filter, developed or grey".into());
    };
    let RawImageData::Integer(codes) = &image.data else {
        return Err("floating-point pixels".into());
    };
    let (full_width, full_height) = (image.width, image.height);
    if image.cpp != 1 || codes.len() != full_width * full_height {
        let found = codes.len();
        return Err(format!("{found} samples for {full_width}x{full_height} pixels"));
    }
    let (left, top, width, height) = match image.active_area {
        Some(area) => (area.p.x, area.p.y, area.d.w, area.d.h),
        None => (0, 0, full_width, full_height),
    };
    let inside = left.checked_add(width).is_some_and(|right| right <= full_width)
        && top.checked_add(height).is_some_and(|bottom| bottom <= full_height);
    if !inside || width < 2 || height < 2 {
        return Err(format!(
            "{width}x{height} light-sensitive pixels from ({left}, {top}) of {full_width}x{full_height}"
        ));
    }
    let cfa = &filter.cfa;
    if [cfa.width, cfa.height] != [2, 2] || image.fuji_rotation_width.is_some() {
        return Err(format!("a colour filter of {}x{} sites", cfa.width, cfa.height));
    }
    let pattern = cfa.shift(left % 2, top % 2).name;
    let bayer = Bayer::parse(&pattern).map_err(|_| format!("a colour filter {pattern}"))?;
    // DNG counts black levels from the active area, the tables of cameras from the sensor's corner.
    let (row, column) = if levels_from_active_area { (0, 0) } else { (top, left) };
    let black = &image.blacklevel;
    let mut black_levels = [0.0; 4];
    for (site, level) in black_levels.iter_mut().enumerate() {
        let [h, w] = [black.height, black.width];
        if !matches!([h, w], [1 | 2, 1 | 2]) {
            return Err(format!("black levels of {w}x{h} sites"));
        }
        let at = (row + site / 2) % h * w + (column + site % 2) % w;
        let rational = black.levels.get(at).ok_or("too few black levels")?;
        *level = f64::from(rational.n) / f64::from(rational.d);
    }
    let white = image.whitelevel.0.iter().copied().min().unwrap_or(0);
    let white_level = u16::try_from(white).map_err(|_| format!("white level {white}"))?;
    // NaN where a camera divides by zero.
    if !black_levels.iter().all(|b| (0.0..f64::from(white_level)).contains(b)) {
        return Err(format!("black levels {black_levels:?} and white level {white_level}"));
    }
    let rows = codes.chunks_exact(full_width).skip(top).take(height);
    let codes = rows.flat_map(|line| &line[left..left + width]).copied().collect();
    Ok(RawMosaic { width, height, codes, bayer, black_levels, white_level, exposure_s })
}
