//! Whether the pictures are the sequence that they are taken for.

use crate::error::{CalibrationError, Result};
use crate::photo::Photo;
use crate::structured_light::layout::CodeLayout;
use crate::structured_light::pairing::Pairing;
use crate::structured_light::samples::Samples;

/// Pixels of which picture and inverse are both lit or both dark, as a share of the lit pixels:
/// none but for noise and highlights if they belong together, half of them if they do not.
const MOST_UNPAIRED: f64 = 0.15;
/// Way that a code goes along a line over the range that it covers: 1 where the surface is smooth,
/// more where objects stand in front of each other, which is then looked into.
const MOST_DETOUR: f64 = 1.05;
/// A sequence is taken for swapped only if putting it right shortens the way to this share.
const SWAPPED: f64 = 0.93;

/// Checks number, sizes and order of the pictures. Returns the standard deviation of a difference
/// of two pictures where nothing changes, codes.
///
/// # Errors
/// The first picture that does not fit, by name, and what it looks like instead.
pub(crate) fn check_sequence(layout: &CodeLayout, pictures: &[Photo]) -> Result<f64> {
    if pictures.len() != layout.pictures() {
        let last = pictures.last().map_or("no pictures".into(), |p| p.name.clone());
        let reason = format!(
            "expected {} pictures for {} x {} projector pixels, found {}",
            layout.pictures(),
            layout.projector[0],
            layout.projector[1],
            pictures.len()
        );
        return Err(CalibrationError::CodeSequence { picture: last, reason });
    }
    check_shapes(pictures)?;
    let samples = Samples::take(layout, pictures);
    let name = |at: usize| pictures.get(at).map_or("", |p| p.name.as_str());
    let wrong = |at: usize, reason: String| {
        Err(CalibrationError::CodeSequence { picture: name(at).into(), reason })
    };
    let [white, black] = layout.white_black_at();
    if samples.lit() == 0 {
        return wrong(
            white,
            format!("nowhere brighter than {}: nothing is lit by the projector", name(black)),
        );
    }
    let order: Vec<usize> = (0..layout.pictures()).collect();
    let mending = Pairing::of(&samples).exchanges(&samples);
    let mending = samples.likeliest(&mending, layout.back_lit);
    if let Some((&(a, b), others)) = mending.split_first() {
        return wrong(
            a,
            format!("looks exchanged with {}{}", name(b), alternatives(others, &name)),
        );
    }
    if samples.brighter(black, white) {
        return wrong(
            white,
            format!("expected all light, but {} is brighter: the two look exchanged", name(black)),
        );
    }
    if let Some(&first) = samples.unpaired(&order, MOST_UNPAIRED).first() {
        if let Some((a, b)) = samples.twins(&[first, first + 1]) {
            return wrong(a, format!("shows the same as {}, but must not", name(b)));
        }
        return wrong(
            first,
            format!(
                "does not go with {}, which should be its inverse: one of the two is of another \
                 place or pose",
                name(first + 1)
            ),
        );
    }
    for axis in 0..2 {
        let ways = samples.way(&order, axis);
        if ways.length <= MOST_DETOUR * ways.range {
            continue;
        }
        if let Some((a, b)) = samples.shortest_exchange(&order, axis, SWAPPED * ways.length) {
            return wrong(
                a,
                format!("looks exchanged with {}: the code jumps to and fro as it is", name(b)),
            );
        }
    }
    let handedness = samples.handedness(&order);
    let mirrored = handedness < 0.0;
    if handedness != 0.0 && mirrored != layout.back_lit {
        let seen = if mirrored {
            "mirrored, as if lit from behind"
        } else {
            "not mirrored, though it is lit from behind"
        };
        let mirroring = samples.mirroring(&order);
        let Some((&(a, b), others)) = mirroring.split_first() else {
            return wrong(white, format!("the projector's picture appears {seen}"));
        };
        return wrong(
            a,
            format!(
                "the projector's picture appears {seen}: exchanged with {}{}?",
                name(b),
                alternatives(others, &name)
            ),
        );
    }
    Ok(samples.noise())
}

/// Other exchanges that explain the pictures as well.
fn alternatives<'a>(exchanges: &[(usize, usize)], name: &dyn Fn(usize) -> &'a str) -> String {
    exchanges.iter().map(|&(a, b)| format!(", or {} with {}", name(a), name(b))).collect()
}

fn check_shapes(pictures: &[Photo]) -> Result<()> {
    let Some(first) = pictures.first() else { return Ok(()) };
    for photo in pictures {
        photo.check()?;
        let shape = |p: &Photo| (p.width, p.height, p.channels, p.max_value);
        if shape(photo) != shape(first) {
            return Err(CalibrationError::Mismatch {
                picture: photo.name.clone(),
                expected: format!("{} as {}", first.shape(), first.name),
                found: photo.shape(),
            });
        }
    }
    Ok(())
}
