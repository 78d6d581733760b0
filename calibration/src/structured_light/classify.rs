//! Whether a pixel was lit: direct light against light that came by way of other points.

use crate::photo::Photo;

/// Grey code of a pixel of 1 or 3 channels: Rec. 601 luma, in 1/256.
pub(crate) fn grey(pixel: &[u16]) -> i32 {
    match *pixel {
        [v] => i32::from(v),
        [r, g, b] => (77 * i32::from(r) + 150 * i32::from(g) + 29 * i32::from(b)) >> 8,
        _ => 0,
    }
}

/// Grey codes of one row of a picture.
pub(crate) fn grey_row(photo: &Photo, y: usize, out: &mut [i32]) {
    let row = photo.data.chunks_exact(photo.width * photo.channels).nth(y).unwrap_or_default();
    if photo.channels == 1 {
        out.iter_mut().zip(row).for_each(|(o, &v)| *o = i32::from(v));
    } else {
        out.iter_mut().zip(row.chunks_exact(photo.channels)).for_each(|(o, px)| *o = grey(px));
    }
}

/// What a pixel gets straight from the projector and what by way of other points, codes above
/// black.
///
/// Under fine stripes, half of them lit, a pixel's brightest is D + G/2 and its darkest G/2
/// (Nayar, Krishnan, Grossberg & Raskar 2006, section 3); black is subtracted beforehand, so that
/// neither the projector's pedestal nor the room is taken for G.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Separation {
    pub(crate) direct: i32,
    pub(crate) global: i32,
}

impl Separation {
    pub(crate) fn new(brightest: i32, darkest: i32, black: i32) -> Self {
        Self { direct: brightest - darkest, global: 2 * (darkest - black).max(0) }
    }

    /// Whether it cannot be told in which of `pattern` and `inverse` the pixel is lit.
    ///
    /// A lit pixel has at least D, one that is not at most G (Xu & Aliaga 2007, section 4.1): with
    /// D > G the brighter picture decides, otherwise only codes outside of both ranges' overlap
    /// do. `noise` is the least difference that means anything.
    pub(crate) fn in_doubt(self, pattern: i32, inverse: i32, black: i32, noise: i32) -> bool {
        let (p, q) = (pattern - black, inverse - black);
        let (direct, global) = (self.direct, self.global);
        // No short cuts: so the loop over a row has no branches.
        let clear =
            (direct > global) | ((p < direct) & (q > global)) | ((p > global) & (q < direct));
        ((p - q).abs() < noise) | (direct < noise) | !clear
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn direct_light_is_told_from_the_rest() {
        // D 100, G 20, black 7.
        let plain = Separation::new(117, 17, 7);
        assert_eq!(plain, Separation { direct: 100, global: 20 });
        assert!(!plain.in_doubt(115, 17, 7, 10));
        assert!(!plain.in_doubt(17, 115, 7, 10));
        assert!(plain.in_doubt(64, 60, 7, 10));
        // D 20, G 100: where the patterns' share of G outweighs D, the brighter picture lies.
        let deep = Separation::new(70, 50, 0);
        assert_eq!(deep, Separation { direct: 20, global: 100 });
        assert!(deep.in_doubt(75, 40, 0, 10));
        assert!(!deep.in_doubt(105, 15, 0, 10));
        assert!(!deep.in_doubt(15, 105, 0, 10));
        // In the projector's shadow there is nothing to decide.
        assert!(Separation::new(52, 50, 0).in_doubt(80, 20, 0, 10));
    }
}
